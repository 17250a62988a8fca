/** The directions of the strokes in the shown frame as the film uses them: the picture's edges and the elements together. */

import type { DirectionKey } from "../document/design";
import type { PreviewRecord } from "../document/records";
import type { Size } from "../drawing/geometry";
import type { Store } from "../state/store";
import { FILM_SIDE_PX, FilmView } from "./film-view";

/** Number of strokes along the shorter side of the picture. */
const STROKES = 22;
/** Length of a stroke, and width, relative to the distance between two. */
const LENGTH = 0.38;

export interface Field {
  columns: number;
  rows: number;
  /** Angle, radians, and strength of each point, row by row. */
  values: Float32Array;
  /** Whether it is the film's; else that of the frame alone. */
  final: boolean;
  moved: Readonly<Record<string, Partial<DirectionKey>>>;
}

export const createTrueField = (store: Store, redraw: () => void): FilmView<Field> =>
  new FilmView(
    store,
    {
      what: "directions",
      channel: "field",
      options: { spacing_px: spacingPx(store.size) },
      wanted: () => store.tool.value === "direction" && store.section("regions") !== undefined,
      of: ["regions", "corrections", "directions"],
      read: readField,
    },
    redraw,
  );

/** Between two strokes, px of the preview, which is never larger than the video. */
function spacingPx({ width, height }: Size): number {
  const scale = Math.min(1, FILM_SIDE_PX / Math.max(width, height));
  return Math.max(2, Math.round((scale * Math.min(width, height)) / STROKES));
}

function readField({ header, payload }: PreviewRecord): Promise<Field> | undefined {
  if (header.type !== "field") return undefined;
  const { columns, rows, final, moved = {} } = header;
  return Promise.resolve({ columns, rows, values: new Float32Array(payload.buffer), final, moved });
}

/** Draw short strokes along the field; the context is in pixels of the video, `px` is one CSS pixel in those. */
export function drawField(
  context: CanvasRenderingContext2D,
  { columns, rows, values }: Field,
  { width, height }: Size,
  px: number,
): void {
  const [across, down] = [width / columns, height / rows];
  const half = LENGTH * Math.min(across, down);
  context.lineCap = "round";
  for (const [color, line] of [
    ["#1b1510", 3.4],
    ["#fff", 1.6],
  ] as const) {
    context.beginPath();
    for (let row = 0; row < rows; row++)
      for (let column = 0; column < columns; column++) {
        const angle = values[2 * (row * columns + column)] ?? 0;
        const [x, y] = [(column + 0.5) * across, (row + 0.5) * down];
        const [dx, dy] = [half * Math.cos(angle), half * Math.sin(angle)];
        context.moveTo(x - dx, y - dy);
        context.lineTo(x + dx, y + dy);
      }
    context.strokeStyle = color;
    context.lineWidth = line * px;
    context.stroke();
  }
}

/**
 * Selections of a paint layer (rectangle, outline), and the tool that moves, scales and turns what is selected, or the whole
 * layer. A map that was made last is changed by the next drag, so that pixels are mixed once however often one drags.
 */

import { notify } from "../../ui/notices";
import type { Point } from "../document/document";
import { clamp } from "../drawing/geometry";
import { changePictureLayer, type KeyPicture, type PictureLayer, type TransformStroke } from "../drawing/strokes";
import {
  after,
  type Box,
  boxOfPaint,
  boxOfRuns,
  IDENTITY,
  inverse,
  type Matrix,
  mapped,
  moved,
  roundedMatrix,
  runsInside,
  runsOfRectangle,
  scaledAbout,
  turnedAbout,
} from "../drawing/transform";
import type { Store } from "../state/store";
import type { PointerSample, StageTool } from "../state/tool";
import type { PaintedKeys } from "./keys";
import type { PaintTool } from "./paint-tool";

/** CSS px within which a handle is taken. */
const GRAB_PX = 14;
const HANDLE_PX = 5;
const TURN_STEP = Math.PI / 12;
const LEAST_SCALE = 0.01;

export interface SelectTool extends StageTool {
  /** Select nothing: tools act on the whole layer again. */
  clear(): void;
  /** Erase the selected pixels; false: none are selected. */
  erase(): boolean;
  /** Move what is selected, or the layer, by whole pixels. */
  nudge(dx: number, dy: number): void;
}

interface Selection {
  /** `pictureKey` and layer. */
  of: string;
  runs: readonly number[];
  outline: readonly Point[];
}

interface Drag {
  how: "move" | "turn" | { handle: Point };
  from: Point;
  /** The map before the drag. */
  matrix: Matrix;
  /** What the map applies to; it lies at `matrix` now. */
  box: Box;
  runs: readonly number[] | null;
}

/** The map of a drag from one point to another, after the one before it. */
export function draggedMatrix(
  { how, from, matrix, box }: Pick<Drag, "how" | "from" | "matrix" | "box">,
  to: Point,
  shift: boolean,
): Matrix {
  if (how === "move") return after(moved(Math.round(to[0] - from[0]), Math.round(to[1] - from[1])), matrix);
  const centre: Point = [box.x + box.width / 2, box.y + box.height / 2];
  if (how === "turn") {
    const at = mapped(matrix, centre);
    const angle = Math.atan2(to[1] - at[1], to[0] - at[0]) - Math.atan2(from[1] - at[1], from[0] - at[0]);
    return after(turnedAbout(at, shift ? Math.round(angle / TURN_STEP) * TURN_STEP : angle), matrix);
  }
  // Scale along the box's own axes, about the side or corner opposite to the handle.
  const { handle } = how;
  const fixed: Point = [box.x + (1 - handle[0]) * box.width, box.y + (1 - handle[1]) * box.height];
  const back = inverse(matrix);
  const [was, now] = [mapped(back, from), mapped(back, to)];
  const factor = (axis: 0 | 1) => {
    if (handle[axis] === 0.5) return 1;
    const length = was[axis] - fixed[axis];
    const found = Math.abs(length) < 1e-6 ? 1 : (now[axis] - fixed[axis]) / length;
    return Math.abs(found) < LEAST_SCALE ? LEAST_SCALE : found;
  };
  let [across, down] = [factor(0), factor(1)];
  if (handle[0] !== 0.5 && handle[1] !== 0.5 && !shift) across = down = (across + down) / 2 || LEAST_SCALE;
  return after(matrix, scaledAbout(fixed, across, down));
}

const HANDLES: readonly Point[] = [0, 0.5, 1]
  .flatMap((x) => [0, 0.5, 1].map((y): Point => [x, y]))
  .filter(([x, y]) => x !== 0.5 || y !== 0.5);

export function createSelectTool(store: Store, keys: PaintedKeys, paint: PaintTool, redraw: () => void): SelectTool {
  let selection: Selection | null = null;
  let drawing: Point[] | null = null;
  let drag: Drag | null = null;
  let preview: { of: KeyPicture; shown: KeyPicture; matrix: Matrix } | null = null;
  let px = 1;
  const boxes = new WeakMap<PictureLayer, Box | null>();

  paint.adjust = (picture) => (preview?.of === picture ? preview.shown : picture);

  /** The picture, and the layer that is chosen; null: none can be moved. */
  function present(): { picture: KeyPicture; layer: PictureLayer; of: string } | null {
    const picture = paint.present();
    const layer = picture && paint.target(picture);
    return picture && layer ? { picture, layer, of: `${store.pictureKey(store.frame.value)}/${layer.id}` } : null;
  }

  const selected = (of: string): Selection | null => (selection?.of === of ? selection : null);

  /** The map that a further drag changes: the layer's newest stroke, if it is one of the same pixels. */
  function newest(layer: PictureLayer, runs: readonly number[] | null): TransformStroke | null {
    const last = layer.strokes.at(-1);
    return last?.kind === "transform" && last.runs === runs ? last : null;
  }

  /** The layer before its newest map. */
  const before = (layer: PictureLayer, runs: readonly number[] | null): PictureLayer =>
    newest(layer, runs) ? { ...layer, strokes: layer.strokes.slice(0, -1) } : layer;

  function boxOf(layer: PictureLayer, of: string): Box | null {
    const own = selected(of);
    if (own) return boxOfRuns(own.runs, store.size);
    const known = boxes.get(layer);
    if (known !== undefined) return known;
    const context = keys.raster.layer(`${of}`, before(layer, null)).getContext("2d");
    const box = context && boxOfPaint(context);
    boxes.set(layer, box);
    return box;
  }

  function withMatrix(
    { picture, layer }: { picture: KeyPicture; layer: PictureLayer },
    runs: readonly number[] | null,
    matrix: Matrix,
  ): KeyPicture {
    const stroke: TransformStroke = { kind: "transform", matrix: roundedMatrix(matrix), runs };
    return changePictureLayer(picture, layer.id, (one) => ({
      ...one,
      strokes: [...before(one, runs).strokes, stroke],
    }));
  }

  function edit(label: string, matrix: Matrix): void {
    const now = present();
    if (!now) return;
    const runs = selected(now.of)?.runs ?? null;
    keys.edit(label, store.frame.value, withMatrix(now, runs, matrix));
  }

  function down(sample: PointerSample): boolean {
    const now = present();
    if (!now) return true;
    const tool = store.tool.value;
    if (tool !== "transform") {
      drawing = [sample.at];
      return true;
    }
    const box = boxOf(now.layer, now.of);
    if (!box) {
      notify(new Error(`The layer “${now.layer.name}” has no paint to move.`));
      return true;
    }
    const runs = selected(now.of)?.runs ?? null;
    const matrix = newest(now.layer, runs)?.matrix ?? IDENTITY;
    const place = ([x, y]: Point) => mapped(matrix, [box.x + x * box.width, box.y + y * box.height]);
    const near = (handle: Point) => Math.hypot(place(handle)[0] - sample.at[0], place(handle)[1] - sample.at[1]);
    const [handle] = [...HANDLES].sort((a, b) => near(a) - near(b));
    const [x, y] = mapped(inverse(matrix), sample.at);
    const inside = x >= box.x && y >= box.y && x <= box.x + box.width && y <= box.y + box.height;
    const scales = handle && near(handle) < GRAB_PX * px;
    drag = { how: scales ? { handle } : inside ? "move" : "turn", from: sample.at, matrix, box, runs };
    return true;
  }

  function move(samples: readonly PointerSample[]): void {
    const last = samples.at(-1);
    if (!last) return;
    if (drawing) {
      if (store.tool.value === "rectangle") drawing = [drawing[0] ?? last.at, last.at];
      else drawing.push(...samples.map(({ at }) => at));
    }
    const now = present();
    if (drag && now) {
      const matrix = draggedMatrix(drag, last.at, last.shift);
      preview = { of: now.picture, shown: withMatrix(now, drag.runs, matrix), matrix };
    }
    redraw();
  }

  function up(): void {
    if (drawing) select(drawing);
    const label = drag?.how === "move" ? "Move" : drag?.how === "turn" ? "Turn" : "Scale";
    const matrix = preview?.matrix;
    cancel();
    if (matrix) edit(label, matrix);
  }

  function cancel(): void {
    [drawing, drag, preview] = [null, null, null];
    redraw();
  }

  /** Select what the pointer has drawn around; a click selects nothing. */
  function select(points: readonly Point[]): void {
    const now = present();
    const [first, last] = [points[0], points.at(-1)];
    if (!now || !first || !last) return;
    const { width, height } = store.size;
    const outline = points.map(([x, y]): Point => [clamp(x, 0, width), clamp(y, 0, height)]);
    const corner = outline.at(-1) as Point;
    const rectangle = store.tool.value === "rectangle";
    const [start] = outline as [Point, ...Point[]];
    const runs = rectangle ? runsOfRectangle(start, corner, store.size) : runsInside(outline, store.size);
    const corners: Point[] = [start, [corner[0], start[1]], corner, [start[0], corner[1]]];
    selection = runs.length ? { of: now.of, runs, outline: rectangle ? corners : outline } : null;
  }

  function draw(context: CanvasRenderingContext2D, pixel: number): void {
    px = pixel;
    const now = present();
    if (!now) return;
    const runs = selected(now.of)?.runs ?? null;
    const matrix = preview?.matrix ?? newest(now.layer, runs)?.matrix ?? IDENTITY;
    const outline = selected(now.of)?.outline.map((point) => mapped(matrix, point));
    if (outline) dashed(context, outline, true);
    if (drawing?.length) {
      const [[ax, ay], [bx, by]] = [drawing[0] as Point, drawing.at(-1) as Point];
      dashed(
        context,
        store.tool.value === "rectangle"
          ? [
              [ax, ay],
              [bx, ay],
              [bx, by],
              [ax, by],
            ]
          : drawing,
        true,
      );
    }
    if (store.tool.value === "transform") drawHandles(context, now, matrix);
  }

  function drawHandles(
    context: CanvasRenderingContext2D,
    now: { layer: PictureLayer; of: string },
    matrix: Matrix,
  ): void {
    const box = boxOf(now.layer, now.of);
    if (!box) return;
    const place = ([x, y]: Point) => mapped(matrix, [box.x + x * box.width, box.y + y * box.height]);
    dashed(
      context,
      (
        [
          [0, 0],
          [1, 0],
          [1, 1],
          [0, 1],
        ] as Point[]
      ).map(place),
      true,
    );
    for (const [x, y] of HANDLES.map(place)) {
      context.beginPath();
      context.rect(x - HANDLE_PX * px, y - HANDLE_PX * px, 2 * HANDLE_PX * px, 2 * HANDLE_PX * px);
      Object.assign(context, { fillStyle: "#fff", strokeStyle: "#222", lineWidth: px });
      context.fill();
      context.stroke();
    }
  }

  function dashed(context: CanvasRenderingContext2D, points: readonly Point[], closed: boolean): void {
    context.save();
    context.lineWidth = 1.5 * px;
    for (const [color, offset] of [
      ["#fff", 0],
      ["#222", 5 * px],
    ] as const) {
      context.beginPath();
      for (const [x, y] of points) context.lineTo(x, y);
      if (closed) context.closePath();
      context.setLineDash([5 * px, 5 * px]);
      Object.assign(context, { strokeStyle: color, lineDashOffset: offset });
      context.stroke();
    }
    context.restore();
  }

  return {
    cursor: "crosshair",
    down,
    move,
    up,
    cancel,
    draw,
    clear() {
      selection = null;
      redraw();
    },
    erase() {
      const now = present();
      const own = now && selected(now.of);
      if (!now || !own) return false;
      edit("Erase the selection", [0, 0, 0, 0, 0, 0]);
      selection = null;
      return true;
    },
    nudge(dx, dy) {
      const now = present();
      if (!now) return;
      const runs = selected(now.of)?.runs ?? null;
      edit("Move", after(moved(dx, dy), newest(now.layer, runs)?.matrix ?? IDENTITY));
    },
  };
}

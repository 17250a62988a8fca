/** A brush that corrects the segmentation: what it covers belongs to the selected region, with Alt to everything else. */

import { type Correction, REST } from "../document/design";
import type { Point } from "../document/document";
import { simplify } from "../drawing/geometry";
import type { Store } from "../state/store";
import type { StageTool } from "../state/tool";

const SIMPLIFY = 0.001;
const COLOURS = { region: "rgb(255 214 90 / 60%)", rest: "rgb(12 9 7 / 60%)" } as const;

/** The corrections of the shown frame. */
export const correctionsHere = (store: Store): Correction[] =>
  (store.design.corrections ?? []).filter(({ frame }) => frame === store.frame.value);

export function removeCorrections(store: Store): void {
  const frame = store.frame.value;
  store.editDesign("Remove corrections", (design) => ({
    ...design,
    corrections: design.corrections?.filter((one) => one.frame !== frame) ?? [],
  }));
}

export function createCorrectionTool(store: Store, redraw: () => void): StageTool {
  let points: Point[] = [];
  let region = REST;

  function add(): void {
    const { width, height } = store.size;
    const shares = points.map(([x, y]): Point => [round(x / width), round(y / height)]);
    const stroke: Correction = {
      region,
      frame: store.frame.value,
      points: simplify(shares, SIMPLIFY),
      width: Math.max(1e-3, round(store.brush.value.size / height)),
    };
    store.editDesign("Correct a region", (design) => ({
      ...design,
      corrections: [...(design.corrections ?? []), stroke],
    }));
  }

  return {
    cursor: "crosshair",
    down({ at, alt }) {
      region = alt ? REST : store.region.value || REST;
      points = [at];
      redraw();
      return true;
    },
    move(samples) {
      points.push(...samples.map(({ at }) => at));
      redraw();
    },
    up() {
      if (points.length) add();
      points = [];
      redraw();
    },
    cancel() {
      points = [];
      redraw();
    },
    /** The strokes of the frame, until the service has the map, and the one under the pointer. */
    draw(context) {
      const { width, height } = store.size;
      const now = { region, points, size: store.brush.value.size };
      const strokes = correctionsHere(store).map((stroke) => ({
        region: stroke.region,
        points: stroke.points.map(([x, y]): Point => [x * width, y * height]),
        size: stroke.width * height,
      }));
      context.save();
      context.lineCap = context.lineJoin = "round";
      for (const one of [...strokes, now]) {
        const [first] = one.points;
        if (!first) continue;
        const mine = one.region !== REST && one.region === store.region.value;
        context.globalAlpha = one === now ? 1 : 0.4;
        context.strokeStyle = mine ? COLOURS.region : COLOURS.rest;
        context.lineWidth = one.size;
        context.beginPath();
        context.moveTo(first[0], first[1] + 0.01);
        for (const [x, y] of one.points) context.lineTo(x, y);
        context.stroke();
      }
      context.restore();
    },
  };
}

const round = (value: number): number => Math.round(value * 1e4) / 1e4;

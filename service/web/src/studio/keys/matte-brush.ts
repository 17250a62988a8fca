/** Brush and eraser that correct the matte of a layer: a plain line, whose width follows the pressure. */

import { isNear, type Sample, widthAt } from "../drawing/strokes";
import type { Store } from "../state/store";
import { type PointerSample, type StageTool, sampleOf } from "../state/tool";

/** Points as shares of the frame's sides, each with the width there as a share of the frame's width. */
export type MatteStroke = readonly (readonly [x: number, y: number, width: number])[];

const LEAST_DISTANCE_PX = 1;
/** Number of points that the service takes. */
const MOST_POINTS = 10_000;
const COLOURS = { add: "rgb(255 214 90 / 60%)", erase: "rgb(24 18 40 / 60%)" } as const;

/** `erase`: whether it takes away; with Alt, each does what the other one does. */
export function createMatteBrush(
  store: Store,
  erase: boolean,
  mark: (stroke: MatteStroke, erase: boolean) => void,
  redraw: () => void,
): StageTool {
  let samples: Sample[] = [];
  let away = erase;

  function add(pointed: PointerSample): void {
    const sample = sampleOf(pointed);
    const last = samples.at(-1);
    if ((!last || !isNear(last, sample, LEAST_DISTANCE_PX)) && samples.length < MOST_POINTS) samples.push(sample);
  }

  function end(): void {
    samples = [];
    redraw();
  }

  return {
    cursor: "crosshair",
    down(sample) {
      samples = [];
      away = erase !== sample.alt;
      add(sample);
      redraw();
      return true;
    },
    move(more) {
      more.forEach(add);
      redraw();
    },
    up() {
      const { width, height } = store.size;
      const size = store.brush.value.size;
      const stroke = samples.map(
        ([x, y, pressure]) =>
          [share(x / width), share(y / height), Math.max(1e-4, share(widthAt(size, pressure) / width))] as const,
      );
      if (stroke.length) mark(stroke, away);
      end();
    },
    cancel: end,
    draw(context) {
      const size = store.brush.value.size;
      const [first] = samples;
      if (!first) return;
      context.save();
      context.lineCap = "round";
      context.strokeStyle = away ? COLOURS.erase : COLOURS.add;
      context.lineWidth = widthAt(size, first[2]);
      context.beginPath();
      context.moveTo(first[0], first[1] + 0.01);
      for (const [x, y] of samples) context.lineTo(x, y);
      context.stroke();
      context.restore();
    },
  };
}

const share = (value: number): number => Math.round(1e4 * Math.min(1, Math.max(0, value))) / 1e4;

/** The smudge brush: it takes up the paint under it and lays it down along its way. */

import { clamp } from "./geometry";
import { type Stamp, StampPath } from "./stamp-path";
import { type Sample, type SmudgeStroke, widthAt } from "./strokes";
import { type Cover, TipShape } from "./tip-shape";

type Context = CanvasRenderingContext2D;

/** Distance between two dabs without a tip, in widths of the stroke. */
const SPACING = 1 / 20;
/** Share of the carried paint that is kept along one width of the stroke, at full strength. */
const KEPT = 0.7;
/** Share of the radius within which a dab without a tip is at full strength; from there it fades to none. */
const CORE = 0.5;

/** Strength of a dab at a pixel of its box, by row and column from its centre. */
type Mask = (row: number, column: number) => number;

/**
 * Smudges one layer along a stroke, dab by dab, as its samples arrive. With a tip, a dab has the shape of its stamps. The carried paint is mixed in whole pixels with
 * premultiplied alpha, so that the same samples give the same pixels, and opaque paint stays opaque.
 */
export class Smudger {
  /** Side of the box of a dab, px. */
  private readonly side: number;
  /** The carried paint: premultiplied red, green, blue, and alpha, 0..255. */
  private readonly carried: Float32Array;
  private empty = true;
  private last: Sample | null = null;
  /** Distance to the next dab, px. */
  private left = 0;
  private readonly spacing: number;
  /** Share of the carried paint that a dab keeps. */
  private readonly kept: number;
  private readonly path: StampPath | null = null;
  private readonly shape: TipShape | null = null;

  constructor(
    private readonly context: Context,
    private readonly stroke: SmudgeStroke,
  ) {
    this.side = 2 * Math.ceil(stroke.size / 2) + 1;
    this.carried = new Float32Array(4 * this.side * this.side);
    const { tip, seed = 0 } = stroke;
    this.spacing = Math.max(1, stroke.size * (tip?.spacing ?? SPACING));
    this.kept = (KEPT * stroke.opacity) ** (this.spacing / stroke.size);
    if (tip) {
      this.path = new StampPath(tip, stroke.size, seed);
      this.shape = new TipShape(tip, seed);
    }
  }

  /** Continue to a sample. */
  to(sample: Sample): void {
    if (this.path) this.path.to(sample, (stamp) => this.stamp(stamp));
    else this.toPlain(sample);
  }

  private stamp(stamp: Stamp): void {
    const [x, y] = [Math.round(stamp.x), Math.round(stamp.y)];
    const radius = Math.min(stamp.radius, this.stroke.size / 2); // a pen that leans makes no larger box
    const cover = this.shape?.of({ ...stamp, x: x + 0.5, y: y + 0.5, radius });
    if (cover) this.dab(x, y, maskOf(cover, x, y));
  }

  private toPlain(sample: Sample): void {
    const from = this.last;
    this.last = sample;
    if (!from) {
      this.plainDab(sample);
      this.left = this.spacing;
      return;
    }
    const length = Math.hypot(sample[0] - from[0], sample[1] - from[1]);
    let at = this.left;
    for (; at <= length; at += this.spacing) {
      const t = at / length;
      const between = (i: 0 | 1 | 2) => from[i] + t * (sample[i] - from[i]);
      this.plainDab([between(0), between(1), between(2)]);
    }
    this.left = at - length;
  }

  private plainDab([x, y, pressure]: Sample): void {
    const radius = widthAt(this.stroke.size, pressure) / 2;
    this.dab(x, y, (row, column) => maskAt(Math.hypot(column, row), radius));
  }

  /** Mix the carried paint with the layer's around a point, and lay it down; the first dab on the layer only takes paint up. */
  private dab(x: number, y: number, mask: Mask): void {
    const { side, carried } = this;
    const { width, height } = this.context.canvas;
    const half = (side - 1) / 2;
    const [left, top] = [Math.round(x) - half, Math.round(y) - half];
    if (left >= width || top >= height || left + side <= 0 || top + side <= 0) return;
    const first = this.empty;
    this.empty = false;
    const box = this.context.getImageData(left, top, side, side);
    const keep = first ? 0 : this.kept;
    // beyond its edge, the layer counts as its outermost pixels
    const inside = (at: number, start: number, length: number) => clamp(at, -start, length - 1 - start);
    for (let row = 0, at = 0; row < side; row++) {
      const line = side * inside(row, top, height);
      for (let column = 0; column < side; column++, at += 4) {
        take(box.data, 4 * (line + inside(column, left, width)), carried, at, keep);
        const share = first ? 0 : mask(row - half, column - half);
        if (share) lay(box.data, carried, at, share);
      }
    }
    if (!first) this.context.putImageData(box, left, top);
  }
}

/** The paint of a stamp as strength of a dab around the pixel (x, y). */
function maskOf({ left, top, width, height, paint }: Cover, x: number, y: number): Mask {
  return (row, column) => {
    const [i, j] = [x + column - left, y + row - top];
    return i < 0 || j < 0 || i >= width || j >= height ? 0 : (paint[j * width + i] ?? 0);
  };
}

/** Strength of a dab at a distance from its centre, 0..1. */
function maskAt(distance: number, radius: number): number {
  return clamp((1 - distance / Math.max(radius, 0.5)) / (1 - CORE), 0, 1);
}

/** Mix the pixel at `from` into the carried paint at `at`, which keeps the share `keep` of its own. */
function take(data: Uint8ClampedArray, from: number, carried: Float32Array, at: number, keep: number): void {
  const alpha = data[from + 3] ?? 0;
  for (let channel = 0; channel < 4; channel++) {
    const value = channel < 3 ? ((data[from + channel] ?? 0) * alpha) / 255 : alpha;
    carried[at + channel] = keep * (carried[at + channel] ?? 0) + (1 - keep) * value;
  }
}

/** Lay the carried paint on the pixel at `at`, 0 < `mask` <= 1. */
function lay(data: Uint8ClampedArray, carried: Float32Array, at: number, mask: number): void {
  const before = (1 - mask) * (data[at + 3] ?? 0);
  const alpha = before + mask * (carried[at + 3] ?? 0);
  for (let channel = 0; channel < 3; channel++) {
    const color = (before * (data[at + channel] ?? 0)) / 255 + mask * (carried[at + channel] ?? 0);
    data[at + channel] = alpha > 0 ? (255 * color) / alpha : 0;
  }
  data[at + 3] = alpha;
}

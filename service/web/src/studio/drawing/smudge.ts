/** The smudge brush: it takes up the paint under it and lays it down along its way. */

import { clamp } from "./geometry";
import { type Sample, type SmudgeStroke, widthAt } from "./strokes";

type Context = CanvasRenderingContext2D;

/** Distance between two dabs, in widths of the stroke. */
const SPACING = 1 / 20;
/** Share of the carried paint that is kept along one width of the stroke, at full strength. */
const KEPT = 0.7;
/** Share of the radius within which a dab is at full strength; from there it fades to none. */
const CORE = 0.5;

/**
 * Smudges one layer along a stroke, dab by dab, as its samples arrive. The carried paint is mixed in whole pixels with
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

  constructor(
    private readonly context: Context,
    private readonly stroke: SmudgeStroke,
  ) {
    this.side = 2 * Math.ceil(stroke.size / 2) + 1;
    this.carried = new Float32Array(4 * this.side * this.side);
    this.spacing = Math.max(1, stroke.size * SPACING);
    this.kept = (KEPT * stroke.opacity) ** (this.spacing / stroke.size);
  }

  /** Continue to a sample. */
  to(sample: Sample): void {
    const from = this.last;
    this.last = sample;
    if (!from) {
      this.dab(sample);
      this.left = this.spacing;
      return;
    }
    const length = Math.hypot(sample[0] - from[0], sample[1] - from[1]);
    let at = this.left;
    for (; at <= length; at += this.spacing) {
      const t = at / length;
      const between = (i: 0 | 1 | 2) => from[i] + t * (sample[i] - from[i]);
      this.dab([between(0), between(1), between(2)]);
    }
    this.left = at - length;
  }

  /** Mix the carried paint with the layer's around a point, and lay it down; the first dab on the layer only takes paint up. */
  private dab([x, y, pressure]: Sample): void {
    const { side, carried } = this;
    const { width, height } = this.context.canvas;
    const half = (side - 1) / 2;
    const [left, top] = [Math.round(x) - half, Math.round(y) - half];
    if (left >= width || top >= height || left + side <= 0 || top + side <= 0) return;
    const first = this.empty;
    this.empty = false;
    const box = this.context.getImageData(left, top, side, side);
    const radius = widthAt(this.stroke.size, pressure) / 2;
    const keep = first ? 0 : this.kept;
    // beyond its edge, the layer counts as its outermost pixels
    const inside = (at: number, start: number, length: number) => clamp(at, -start, length - 1 - start);
    for (let row = 0, at = 0; row < side; row++) {
      const line = side * inside(row, top, height);
      for (let column = 0; column < side; column++, at += 4) {
        take(box.data, 4 * (line + inside(column, left, width)), carried, at, keep);
        const mask = first ? 0 : maskAt(Math.hypot(column - half, row - half), radius);
        if (mask) lay(box.data, carried, at, mask);
      }
    }
    if (!first) this.context.putImageData(box, left, top);
  }
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

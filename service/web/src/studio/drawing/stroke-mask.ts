/** The paint of one stroke, stamp by stamp, and how it is laid on a layer's pixels. */

import type { Tip } from "../document/tip";
import { clamp, type Size } from "./geometry";
import { GRAIN_PX, grain } from "./noise";
import { type Rect, unionOf } from "./rect";
import { type Stamp, StampPath } from "./stamp-path";
import type { BrushStroke, Sample } from "./strokes";
import { TipShape } from "./tip-shape";

/** Memory for the paint of a stroke, of the picture's size; it is used again by the next stroke. */
export class PaintBuffers {
  private paint: Float32Array | null = null;
  private shades: Float32Array | null = null;

  constructor(readonly size: Size) {}

  /** Zeros; of the last user, only what it has used is cleared. */
  take(shaded: boolean): { paint: Float32Array; shades: Float32Array | null } {
    const pixels = this.size.width * this.size.height;
    const paint = this.paint ?? new Float32Array(pixels);
    const shades = shaded ? (this.shades ?? new Float32Array(pixels)) : null;
    this.paint = null;
    if (shades) this.shades = null;
    return { paint, shades };
  }

  give(paint: Float32Array, shades: Float32Array | null, used: Rect | null): void {
    if (used)
      for (let y = used.y; y < used.y + used.height; y++) {
        const start = y * this.size.width + used.x;
        paint.fill(0, start, start + used.width);
        shades?.fill(0, start, start + used.width);
      }
    this.paint = paint;
    if (shades) this.shades = shades;
  }
}

/** The paint of a growing stroke. */
export class StrokeMask {
  /** The pixels that the stroke has touched. */
  used: Rect | null = null;
  private readonly path: StampPath;
  private readonly shape: TipShape;
  private readonly paint: Float32Array;
  private readonly shades: Float32Array | null;
  private fresh: Rect | null = null;

  constructor(
    private readonly stroke: BrushStroke,
    private readonly tip: Tip,
    private readonly buffers: PaintBuffers,
  ) {
    const seed = stroke.seed ?? 0;
    this.path = new StampPath(tip, stroke.size, seed);
    this.shape = new TipShape(tip, seed);
    const { paint, shades } = buffers.take(tip.shape === "bristles" && tip.shade > 0);
    this.paint = paint;
    this.shades = shades;
  }

  to(sample: Sample): void {
    this.path.to(sample, (stamp) => this.put(stamp));
  }

  end(): void {
    this.path.end((stamp) => this.put(stamp));
  }

  /** The pixels that were touched since the last call. */
  touched(): Rect | null {
    const { fresh } = this;
    this.fresh = null;
    return fresh;
  }

  /** Give the memory back. */
  free(): void {
    this.buffers.give(this.paint, this.shades, this.used);
    this.used = null;
  }

  private put(stamp: Stamp): void {
    const { width: columns, height: rows } = this.buffers.size;
    const cover = this.shape.of(stamp);
    const [left, right] = [Math.max(0, cover.left), Math.min(columns, cover.left + cover.width)];
    const [top, bottom] = [Math.max(0, cover.top), Math.min(rows, cover.top + cover.height)];
    if (left >= right || top >= bottom) return;
    const { paint, shades } = this;
    const { flow } = stamp;
    for (let y = top; y < bottom; y++) {
      let from = (y - cover.top) * cover.width + left - cover.left;
      for (let at = y * columns + left; at < y * columns + right; at++, from++) {
        const wanted = cover.paint[from] ?? 0;
        const before = paint[at] ?? 0;
        if (wanted <= before) continue;
        paint[at] = before + (wanted - before) * flow;
        if (shades && cover.shades)
          shades[at] = (shades[at] ?? 0) + ((cover.shades[from] ?? 0) - (shades[at] ?? 0)) * flow;
      }
    }
    const rect = { x: left, y: top, width: right - left, height: bottom - top };
    this.used = unionOf(this.used, rect);
    this.fresh = unionOf(this.fresh, rect);
  }

  /**
   * Lay the paint on the pixels of a rectangle.
   *
   * @param data RGBA of the rectangle, 8 bit, not premultiplied; changed in place
   */
  lay(data: Uint8ClampedArray, rect: Rect): void {
    const { opacity, kind } = this.stroke;
    const color = rgbOf(this.stroke.color);
    const amount = this.tip.wet > 0 ? washOf(this.tip.wet) : null;
    const columns = this.buffers.size.width;
    for (let row = 0, to = 0; row < rect.height; row++) {
      const y = rect.y + row;
      for (let x = rect.x, at = y * columns + rect.x; x < rect.x + rect.width; x++, at++, to += 4) {
        const paint = this.paint[at] ?? 0;
        if (!paint) continue;
        const share = opacity * (amount ? amount(paint, x, y) : paint);
        if (kind === "eraser") data[to + 3] = (data[to + 3] ?? 0) * (1 - share);
        else over(data, to, color, share, this.shades ? (this.shades[at] ?? 0) : 0);
      }
    }
  }
}

/** Lay a colour on a pixel; `light` moves it towards white (1) or black (-1). */
function over(data: Uint8ClampedArray, to: number, color: readonly number[], share: number, light: number): void {
  const below = ((data[to + 3] ?? 0) / 255) * (1 - share);
  const alpha = below + share;
  if (alpha <= 0) return;
  for (let channel = 0; channel < 3; channel++) {
    const own = color[channel] ?? 0;
    const lit = own + light * (light > 0 ? 255 - own : own);
    data[to + channel] = (lit * share + (data[to + channel] ?? 0) * below) / alpha;
  }
  data[to + 3] = 255 * alpha;
}

export const rgbOf = (color: string): [number, number, number] => [
  Number.parseInt(color.slice(1, 3), 16),
  Number.parseInt(color.slice(3, 5), 16),
  Number.parseInt(color.slice(5, 7), 16),
];

/** Where the rim of a wash is darkest, and how wide it is, in radii from its edge. */
const RIM = 0.07;
const RIM_WIDTH = 0.08;

/**
 * Pigment of a wash by its depth (0 at its edge, 1 along its middle): it settles at the edge, in the valleys of rough paper,
 * and in pools.
 */
function washOf(wet: number): (depth: number, x: number, y: number) => number {
  const [rough, wash] = [grain("rough", 2), grain("wash")];
  return (depth, x, y) => {
    const at = (y & (GRAIN_PX - 1)) * GRAIN_PX + (x & (GRAIN_PX - 1));
    const [height, pool] = [(rough[at] ?? 0) - 0.5, (wash[at] ?? 0) - 0.5];
    const inside = depth + 0.09 * height - 0.03;
    const body = clamp(inside / 0.05, 0, 1) * (0.42 + 0.15 * pool - 0.14 * height);
    const rim = Math.max(0, 1 - Math.abs(inside - RIM) / RIM_WIDTH);
    return clamp(body + wet * 0.6 * rim * (0.8 + 0.6 * pool), 0, 1);
  };
}

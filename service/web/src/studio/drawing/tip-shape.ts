/** How much paint a stamp leaves at each pixel: its shape, its bristles, and the grain of the paper below it. */

import type { Tip } from "../document/tip";
import { clamp } from "./geometry";
import { GRAIN_PX, grain, random, wander } from "./noise";
import type { Stamp } from "./stamp-path";
import { coverageIn, type Picture, pictureOf } from "./tip-picture";

/** A box of pixels; its values are overwritten by the next stamp. */
export interface Cover {
  left: number;
  top: number;
  width: number;
  height: number;
  /** Paint 0..1, row by row. */
  paint: Float32Array;
  /** Lightness against the colour, -1..1; null: the tip has no shades. */
  shades: Float32Array | null;
}

const BRISTLES = 48;
/** Widths of the stroke in which a bristle's load changes. */
const LOAD_WIDTHS = 2.5;
/** Range of heights over which paint ends in the grain. */
const GRAIN_SOFTNESS = 0.4;
/** Steps of a falloff's table over the squared distance, and of hardnesses with a table of their own. */
const STEPS = 1024;
const HARDNESSES = 256;

const falloffs = new Map<number, Float32Array>();

/** Paint of a round stamp by its squared distance from the centre, 0..1: full up to the hardness, then smoothly to none. */
function falloff(hardness: number): Float32Array {
  const key = Math.round(clamp(hardness, 0, 1) * HARDNESSES);
  const known = falloffs.get(key);
  if (known) return known;
  const core = Math.min(key / HARDNESSES, 0.999);
  const table = new Float32Array(STEPS + 1);
  for (let i = 0; i <= STEPS; i++) {
    const t = clamp((1 - Math.sqrt(i / STEPS)) / (1 - core), 0, 1);
    table[i] = t * t * (3 - 2 * t);
  }
  falloffs.set(key, table);
  return table;
}

/** Make the tables of a tip before its first stroke: they take up to 50 ms. */
export function prepareTip(tip: Tip): void {
  if (tip.grain !== "none") grain(tip.grain, tip.grainScale);
  if (tip.wet) for (const [name, scale] of WASH_GRAINS) grain(name, scale);
  if (tip.picture) pictureOf(tip.picture);
}

/** Grains that a wash takes beside its own. */
const WASH_GRAINS = [
  ["rough", 2],
  ["wash", 1],
] as const;

export class TipShape {
  private readonly cover: Cover;
  private readonly heights: Float32Array | null;
  private readonly picture: Picture | null;
  private readonly bristles = new Float32Array(BRISTLES + 1);
  private readonly lights = new Float32Array(BRISTLES + 1);

  constructor(
    private readonly tip: Tip,
    private readonly seed: number,
  ) {
    this.heights = tip.grain === "none" || !tip.grainDepth ? null : grain(tip.grain, tip.grainScale);
    this.picture = tip.shape === "picture" && tip.picture ? pictureOf(tip.picture) : null;
    const shades = tip.shape === "bristles" && tip.shade ? new Float32Array(0) : null;
    this.cover = { left: 0, top: 0, width: 0, height: 0, paint: new Float32Array(0), shades };
    for (let i = 0; i <= BRISTLES; i++) this.lights[i] = tip.shade * (2 * random(seed, i, 11) - 1);
  }

  /** The paint of a stamp, within a box that may extend beyond the picture. */
  of(stamp: Stamp): Cover {
    const { cover, tip } = this;
    const reach = stamp.radius * (this.picture ? Math.SQRT2 : 1) + 1;
    cover.left = Math.floor(stamp.x - reach);
    cover.top = Math.floor(stamp.y - reach);
    cover.width = Math.ceil(stamp.x + reach) - cover.left;
    cover.height = Math.ceil(stamp.y + reach) - cover.top;
    const pixels = cover.width * cover.height;
    if (cover.paint.length < pixels) {
      cover.paint = new Float32Array(pixels);
      if (cover.shades) cover.shades = new Float32Array(pixels);
    }
    if (this.picture) this.coverPicture(stamp, this.picture);
    else if (tip.shape === "bristles") this.coverBristles(stamp);
    else this.coverRound(stamp);
    if (this.heights) this.takeGrain(stamp.opacity, this.heights);
    return cover;
  }

  private coverRound({ x, y, radius, angle, opacity }: Stamp): void {
    const { paint, left, top, width, height } = this.cover;
    const outer = radius + 0.5;
    // a rim of at least a pixel is soft, so that the edge has no steps
    const table = falloff(Math.min(this.tip.hardness, (radius - 0.5) / outer));
    const most = opacity * Math.min(1, 2 * radius);
    const profile = this.tip.wet > 0;
    const [cos, sin] = [Math.cos(angle) / outer, Math.sin(angle) / outer];
    const flat = 1 / Math.max(this.tip.roundness, 0.05);
    for (let row = 0, at = 0; row < height; row++) {
      const dy = top + row + 0.5 - y;
      for (let column = 0; column < width; column++, at++) {
        const dx = left + column + 0.5 - x;
        const u = dx * cos + dy * sin;
        const v = (dy * cos - dx * sin) * flat;
        const far = u * u + v * v;
        paint[at] = far >= 1 ? 0 : most * (profile ? 1 - Math.sqrt(far) : (table[(far * STEPS) | 0] ?? 0));
      }
    }
  }

  /** Bristles stand in a row across the stamp's short axis; where the stroke goes that way, they leave streaks. */
  private coverBristles(stamp: Stamp): void {
    const { x, y, radius, angle, opacity } = stamp;
    const { paint, shades, left, top, width, height } = this.cover;
    this.load(stamp.along);
    const { bristles, lights } = this;
    const outer = radius + 0.5;
    const table = falloff(Math.min(this.tip.hardness, (radius - 0.5) / outer));
    const [cos, sin] = [Math.cos(angle) / outer, Math.sin(angle) / outer];
    const flat = 1 / Math.max(this.tip.roundness, 0.05);
    for (let row = 0, at = 0; row < height; row++) {
      const dy = top + row + 0.5 - y;
      for (let column = 0; column < width; column++, at++) {
        const dx = left + column + 0.5 - x;
        const u = (dx * cos + dy * sin) * flat;
        const v = dy * cos - dx * sin;
        const far = u * u + v * v;
        if (far >= 1) {
          paint[at] = 0;
          continue;
        }
        const place = ((v + 1) / 2) * BRISTLES;
        const index = place | 0;
        const part = place - index;
        const one = bristles[index] ?? 0;
        paint[at] = opacity * (table[(far * STEPS) | 0] ?? 0) * (one + part * ((bristles[index + 1] ?? 0) - one));
        if (shades) {
          const light = lights[index] ?? 0;
          shades[at] = light + part * ((lights[index + 1] ?? 0) - light);
        }
      }
    }
  }

  /** The paint that each bristle has left. */
  private load(along: number): void {
    const { dry, hardness } = this.tip;
    const spent = dry ? Math.min(1, along / dry) : 0;
    for (let i = 0; i <= BRISTLES; i++) {
      const own = 0.45 * random(this.seed, i, 12) + 0.55 * wander(this.seed, i, along / LOAD_WIDTHS);
      this.bristles[i] = clamp((own - spent * 0.85 + 0.25 * hardness) * 3.2, 0, 1);
    }
  }

  private coverPicture({ x, y, radius, angle, opacity }: Stamp, picture: Picture): void {
    const { paint, left, top, width, height } = this.cover;
    const [cos, sin] = [Math.cos(angle) / radius, Math.sin(angle) / radius];
    const flat = 1 / Math.max(this.tip.roundness, 0.05);
    const level = picture.for(2 * radius);
    for (let row = 0, at = 0; row < height; row++) {
      const dy = top + row + 0.5 - y;
      for (let column = 0; column < width; column++, at++) {
        const dx = left + column + 0.5 - x;
        paint[at] = opacity * coverageIn(level, dx * cos + dy * sin, (dy * cos - dx * sin) * flat);
      }
    }
  }

  /** Paint stays on the heights of the grain; the more of it, the deeper it comes. */
  private takeGrain(opacity: number, heights: Float32Array): void {
    const { paint, left, top, width, height } = this.cover;
    const { grainDepth } = this.tip;
    const most = 0.4 + 0.6 * opacity;
    for (let row = 0, at = 0; row < height; row++) {
      const line = ((top + row) & (GRAIN_PX - 1)) * GRAIN_PX;
      for (let column = 0; column < width; column++, at++) {
        const amount = paint[at] ?? 0;
        if (!amount) continue;
        const valley = grainDepth * (heights[line + ((left + column) & (GRAIN_PX - 1))] ?? 0);
        paint[at] = most * clamp((amount - valley) / GRAIN_SOFTNESS, 0, 1);
      }
    }
  }
}

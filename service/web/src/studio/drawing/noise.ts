/** Random numbers that depend on integers only, so that a stroke is the same whenever it is drawn, and grains of paper. */

import type { GrainName } from "../document/tip";

/** Pseudo-random number 0 <= r < 1 of up to three integers (finalizer of MurmurHash3, Appleby 2011). */
export function random(a: number, b = 0, c = 0): number {
  let hash =
    Math.imul(a ^ 0x9e3779b9, 0x85ebca6b) ^
    Math.imul(b + 0x165667b1, 0xc2b2ae35) ^
    Math.imul(c + 0x27d4eb2f, 0x2545f491);
  hash = Math.imul(hash ^ (hash >>> 16), 0x85ebca6b);
  hash = Math.imul(hash ^ (hash >>> 13), 0xc2b2ae35);
  return ((hash ^ (hash >>> 16)) >>> 0) / 2 ** 32;
}

/** Side of a grain, px; it repeats. */
export const GRAIN_PX = 256;

const made = new Map<string, Float32Array>();

/**
 * Heights of a surface, 0..1, 256 x 256, row by row. They are spread evenly: a share t of the pixels is below t, so that a
 * threshold is a share of covered paper.
 *
 * @param scale how much larger than usual its grains are: 1, 2 or 4
 */
export function grain(name: GrainName | "wash", scale = 1): Float32Array {
  const key = `${name} ${scale}`;
  const known = made.get(key) ?? levelled(SURFACES[name], scale);
  made.set(key, known);
  return known;
}

type Surface = (x: number, y: number, period: number) => number;

const SURFACES: Record<GrainName | "wash", Surface> = {
  paper: (x, y, period) =>
    0.55 * lattice(x, y, 2, period, 1) + 0.3 * lattice(x, y, 4, period, 2) + 0.15 * speck(x, y, 3),
  rough: (x, y, period) =>
    0.3 * lattice(x, y, 8, period, 4) +
    0.25 * lattice(x, y, 4, period, 5) +
    0.2 * lattice(x, y, 2, period, 6) +
    0.25 * speck(x, y, 11),
  canvas: (x, y, period) =>
    weave(Math.floor(x), Math.floor(y)) + 0.25 * lattice(x, y, 4, period, 7) + 0.1 * speck(x, y, 8),
  wash: (x, y, period) => 0.65 * lattice(x, y, 64, period, 9) + 0.35 * lattice(x, y, 16, period, 10),
};

const speck = (x: number, y: number, seed: number): number => random(Math.floor(x), Math.floor(y), seed);

/** Threads of 4 px that pass over and under each other, 0..0.65. */
function weave(x: number, y: number): number {
  const over = ((x >> 2) + (y >> 2)) & 1;
  const across = 1 - Math.abs(((over ? y : x) & 3) - 1.5) / 1.5;
  const along = 1 - Math.abs(((over ? x : y) & 3) - 1.5) / 3;
  return 0.65 * (0.7 * across + 0.3 * along);
}

/** Random values on a lattice of `cell` px that repeats after `period` px; between them smooth. */
function lattice(x: number, y: number, cell: number, period: number, seed: number): number {
  const columns = period / cell;
  const [i, j] = [Math.floor(x / cell), Math.floor(y / cell)];
  const [u, v] = [smooth(x / cell - i), smooth(y / cell - j)];
  const at = (di: number, dj: number) => random((i + di) % columns, (j + dj) % columns, seed);
  const top = at(0, 0) + u * (at(1, 0) - at(0, 0));
  const bottom = at(0, 1) + u * (at(1, 1) - at(0, 1));
  return top + v * (bottom - top);
}

const smooth = (t: number): number => t * t * (3 - 2 * t);

/** Each height replaced by the share of lower ones. */
function levelled(surface: Surface, scale: number): Float32Array {
  const heights = new Float32Array(GRAIN_PX * GRAIN_PX);
  for (let i = 0; i < heights.length; i++)
    heights[i] = surface((i % GRAIN_PX) / scale, Math.floor(i / GRAIN_PX) / scale, GRAIN_PX / scale);
  const bins = 4096;
  const below = new Uint32Array(bins + 1);
  const bin = (height: number) => Math.min(bins - 1, Math.floor(height * bins));
  for (const height of heights) below[bin(height) + 1] = (below[bin(height) + 1] ?? 0) + 1;
  for (let i = 1; i <= bins; i++) below[i] = (below[i] ?? 0) + (below[i - 1] ?? 0);
  return heights.map((height) => (below[bin(height)] ?? 0) / heights.length);
}

/** Random values along a line, one lattice point a unit, between them linear; another line for each `seed` and `row`. */
export function wander(seed: number, row: number, at: number): number {
  const index = Math.floor(at);
  const before = random(seed, row, index);
  return before + (at - index) * (random(seed, row, index + 1) - before);
}

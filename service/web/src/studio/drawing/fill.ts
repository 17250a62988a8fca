/** The area that a fill covers: connected pixels of about one colour, also where its outline has gaps. */

import type { Size } from "./geometry";
import { runsOf } from "./strokes";

export interface FillOptions {
  /** Largest difference of a channel from that of the pixel under the pointer, 0..255. */
  tolerance: number;
  /** Gaps of the outline up to this many px are closed. */
  gap?: number;
}

/**
 * Runs of the connected area around a pixel. With `gap`, the area is filled by a square that is wider than the gaps, and
 * then grown to its outline: trapped-ball segmentation (Zhang, Chen, Zhang, Shen, Ban 2009) with one ball.
 *
 * @param pixels RGBA, 8 bit, row by row
 */
export function floodRuns(
  pixels: Uint8ClampedArray,
  size: Size,
  start: readonly [number, number],
  { tolerance, gap = 0 }: FillOptions,
): number[] {
  const [x, y] = [Math.floor(start[0]), Math.floor(start[1])];
  if (x < 0 || y < 0 || x >= size.width || y >= size.height) return [];
  const seed = y * size.width + x;
  const free = alike(pixels, seed, tolerance);
  for (let radius = Math.ceil(gap / 2); radius > 0; radius >>= 1) {
    const filled = ballFill(free, size, seed, radius);
    if (filled) return runsOf(filled);
  }
  return runsOf(flood(free, size, seed));
}

/** 1 where a pixel's colour is near that of pixel `seed`. */
function alike(pixels: Uint8ClampedArray, seed: number, tolerance: number): Uint8Array {
  const [red, green, blue, alpha] = pixels.subarray(4 * seed, 4 * seed + 4) as unknown as [
    number,
    number,
    number,
    number,
  ];
  const free = new Uint8Array(pixels.length / 4);
  for (let i = 0, at = 0; i < free.length; i++, at += 4) {
    const fits =
      Math.abs((pixels[at] ?? 0) - red) <= tolerance &&
      Math.abs((pixels[at + 1] ?? 0) - green) <= tolerance &&
      Math.abs((pixels[at + 2] ?? 0) - blue) <= tolerance &&
      Math.abs((pixels[at + 3] ?? 0) - alpha) <= tolerance;
    if (fits) free[i] = 1;
  }
  return free;
}

/** 1 in the part of `free` that is connected with a pixel (by its four neighbours). */
function flood(free: Uint8Array, { width }: Size, seed: number): Uint8Array {
  const filled = new Uint8Array(free.length);
  const waiting = [seed];
  while (waiting.length) {
    const index = waiting.pop() ?? 0;
    if (!free[index] || filled[index]) continue;
    const row = index - (index % width);
    let left = index;
    while (left > row && free[left - 1] && !filled[left - 1]) left -= 1;
    let right = index;
    while (right < row + width - 1 && free[right + 1] && !filled[right + 1]) right += 1;
    for (const line of [-width, width]) {
      let open = false;
      for (let at = left + line; at <= right + line; at++) {
        const next = at >= 0 && at < free.length && Boolean(free[at]) && !filled[at];
        if (next && !open) waiting.push(at);
        open = next;
      }
    }
    filled.fill(1, left, right + 1);
  }
  return filled;
}

/** The area that a square of 2 radius + 1 px can reach from near a pixel, grown by the radius; null: it has no room there. */
function ballFill(free: Uint8Array, size: Size, seed: number, radius: number): Uint8Array | null {
  const away = distances(free, size);
  const room = new Uint8Array(free.length);
  for (let i = 0; i < room.length; i++) if ((away[i] ?? 0) > radius) room[i] = 1;
  const start = nearest(free, room, size, seed, 2 * radius);
  if (start < 0) return null;
  const filled = flood(room, size, start);
  let edge = rimOf(filled, size);
  for (let step = 0; step < radius; step++) edge = grow(free, filled, size, edge);
  return filled;
}

/** The filled pixels with a neighbour that is not. */
function rimOf(filled: Uint8Array, { width }: Size): number[] {
  const rim: number[] = [];
  for (let at = 0; at < filled.length; at++) {
    if (filled[at] && !(filled[at - 1] && filled[at + 1] && filled[at - width] && filled[at + width])) rim.push(at);
  }
  return rim;
}

/** Distance of each free pixel from the nearest other one, up to 255 px, counted in steps to the eight neighbours. */
function distances(free: Uint8Array, { width, height }: Size): Uint8Array {
  // a frame of one pixel that counts as far away, so that every pixel has eight neighbours
  const columns = width + 2;
  const away = new Uint8Array(columns * (height + 2)).fill(255);
  for (let y = 0; y < height; y++)
    for (let x = 0; x < width; x++) if (!free[y * width + x]) away[(y + 1) * columns + x + 1] = 0;
  for (const by of [1, -1]) {
    const end = by > 0 ? height + 1 : 0;
    for (let y = by > 0 ? 1 : height; y !== end; y += by)
      for (let at = y * columns + (by > 0 ? 1 : width), left = width; left > 0; at += by, left--) {
        const row = at - by * columns;
        const least = Math.min(away[at - by] ?? 0, away[row - 1] ?? 0, away[row] ?? 0, away[row + 1] ?? 0);
        if (least + 1 < (away[at] ?? 0)) away[at] = least + 1;
      }
  }
  const found = new Uint8Array(free.length);
  for (let y = 0; y < height; y++)
    found.set(away.subarray((y + 1) * columns + 1, (y + 1) * columns + 1 + width), y * width);
  return found;
}

/** The pixel of `room` that is fewest steps through `free` away; -1: none within `most` steps. */
function nearest(free: Uint8Array, room: Uint8Array, size: Size, seed: number, most: number): number {
  const seen = new Uint8Array(free.length);
  seen[seed] = 1;
  let edge = [seed];
  for (let step = 0; step <= most && edge.length; step++) {
    const found = edge.find((at) => room[at]);
    if (found !== undefined) return found;
    edge = grow(free, seen, size, edge);
  }
  return -1;
}

/** Fill the free neighbours of some pixels, all eight; returns those that are new. */
function grow(free: Uint8Array, filled: Uint8Array, { width }: Size, edge: readonly number[]): number[] {
  const next: number[] = [];
  for (const at of edge) {
    const x = at % width;
    for (const line of [-width, 0, width])
      for (let by = x > 0 ? -1 : 0; by <= (x < width - 1 ? 1 : 0); by++) {
        const to = at + line + by;
        if (to < 0 || to >= free.length || !free[to] || filled[to]) continue;
        filled[to] = 1;
        next.push(to);
      }
  }
  return next;
}

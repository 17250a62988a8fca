/** Fills: tolerance, and outlines with gaps. */

import { expect, test } from "vitest";
import { floodRuns } from "../../../src/studio/drawing/fill";
import { rowsOf } from "../../../src/studio/drawing/strokes";

/** White pixels with the dark ones of a drawing; "#" is dark, "+" light gray. */
function pixelsOf(rows: readonly string[]): [Uint8ClampedArray, { width: number; height: number }] {
  const width = rows[0]?.length ?? 0;
  const data = new Uint8ClampedArray(4 * width * rows.length).fill(255);
  rows.forEach((row, y) => {
    [...row].forEach((letter, x) => {
      if (letter !== ".") data.fill(letter === "#" ? 20 : 235, 4 * (y * width + x), 4 * (y * width + x) + 3);
    });
  });
  return [data, { width, height: rows.length }];
}

/** A box of 41 x 41 px in the middle of 61 x 61, with a gap of some px in its right side. */
function box(gap: number): string[] {
  return Array.from({ length: 61 }, (_, y) =>
    Array.from({ length: 61 }, (_, x) => {
      const outline = Math.max(Math.abs(x - 30), Math.abs(y - 30)) === 20;
      const open = x === 50 && Math.abs(y - 30) < gap / 2;
      return outline && !open ? "#" : ".";
    }).join(""),
  );
}

const count = (runs: readonly number[]) => runs.reduce((all, value, i) => (i % 2 ? all + value : all), 0);

test("a fill stops at another colour", () => {
  const [data, size] = pixelsOf([".#.", ".#.", ".#."]);
  expect(floodRuns(data, size, [0, 0], { tolerance: 10 })).toEqual([0, 1, 3, 1, 6, 1]);
  expect(floodRuns(data, size, [-1, 0], { tolerance: 10 })).toEqual([]);
});

test("a larger tolerance takes in colours that differ more", () => {
  const [data, size] = pixelsOf([".++#."]);
  expect(floodRuns(data, size, [0, 0], { tolerance: 10 })).toEqual([0, 1]);
  expect(floodRuns(data, size, [0, 0], { tolerance: 20 })).toEqual([0, 3]);
  expect(floodRuns(data, size, [0, 0], { tolerance: 255 })).toEqual([0, 5]);
});

test("a gap leaks, unless it is closed: then the box is filled to its corners, and no pixel beyond its outline", () => {
  for (const gap of [1, 3, 5]) {
    const [data, size] = pixelsOf(box(gap));
    expect(count(floodRuns(data, size, [30, 30], { tolerance: 10 }))).toBe(61 * 61 - 160 + gap);
    const runs = floodRuns(data, size, [30, 30], { tolerance: 10, gap: gap + 1 });
    const rows = rowsOf(runs, size.width);
    expect(Math.max(...rows.map(([x, , length]) => x + length))).toBeLessThanOrEqual(51);
    const inside = count(runs);
    expect(inside).toBeGreaterThanOrEqual(39 * 39);
    expect(inside).toBeLessThanOrEqual(39 * 39 + gap);
  }
});

test("a gap wider than asked for leaks; a place too narrow for closing is filled as it is", () => {
  const [open, size] = pixelsOf(box(9));
  expect(count(floodRuns(open, size, [30, 30], { tolerance: 10, gap: 4 }))).toBeGreaterThan(2000);
  const [narrow, small] = pixelsOf(["#####", "#...#", "#####"]);
  expect(floodRuns(narrow, small, [2, 1], { tolerance: 10, gap: 12 })).toEqual([6, 3]);
});

test("beside the outline, a fill with closing begins at the nearest place with room", () => {
  const [data, size] = pixelsOf(box(3));
  expect(count(floodRuns(data, size, [11, 11], { tolerance: 10, gap: 4 }))).toBeGreaterThanOrEqual(39 * 39);
});

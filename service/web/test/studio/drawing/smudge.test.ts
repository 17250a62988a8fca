import { expect, test } from "vitest";
import { ROUND, type Tip } from "../../../src/studio/document/tip";
import { Smudger } from "../../../src/studio/drawing/smudge";
import type { Sample } from "../../../src/studio/drawing/strokes";

const SIZE = 40;
const RED = [200, 30, 10, 255];

/** A canvas's context, as far as smudges use it: pixels outside are transparent. */
function contextOf(pixel: (x: number, y: number) => number[]) {
  const data = new Uint8ClampedArray(4 * SIZE * SIZE);
  for (let y = 0; y < SIZE; y++) for (let x = 0; x < SIZE; x++) data.set(pixel(x, y), 4 * (y * SIZE + x));
  const inside = (x: number, y: number) => x >= 0 && y >= 0 && x < SIZE && y < SIZE;
  const context = {
    canvas: { width: SIZE, height: SIZE },
    getImageData(left: number, top: number, width: number, height: number) {
      const box = new Uint8ClampedArray(4 * width * height);
      for (let i = 0; i < width * height; i++) {
        const [x, y] = [left + (i % width), top + Math.floor(i / width)];
        if (inside(x, y)) box.set(data.slice(4 * (y * SIZE + x), 4 * (y * SIZE + x) + 4), 4 * i);
      }
      return { data: box, width, height };
    },
    putImageData(box: { data: Uint8ClampedArray; width: number; height: number }, left: number, top: number) {
      for (let i = 0; i < box.width * box.height; i++) {
        const [x, y] = [left + (i % box.width), top + Math.floor(i / box.width)];
        if (inside(x, y)) data.set(box.data.slice(4 * i, 4 * i + 4), 4 * (y * SIZE + x));
      }
    },
  };
  return { data, context: context as unknown as CanvasRenderingContext2D };
}

const at = (data: Uint8ClampedArray, x: number, y: number) => [
  ...data.slice(4 * (y * SIZE + x), 4 * (y * SIZE + x) + 4),
];

function smudged(pixel: (x: number, y: number) => number[], samples: Sample[], size = 10, opacity = 1) {
  const { data, context } = contextOf(pixel);
  const smudger = new Smudger(context, { kind: "smudge", size, opacity, samples });
  for (const sample of samples) smudger.to(sample);
  return data;
}

const half = (x: number) => (x < 20 ? RED : [0, 0, 0, 0]);
const ACROSS: Sample[] = [
  [14, 20, 1],
  [34, 20, 1],
];

test("paint is carried along the stroke, and thins out", () => {
  const data = smudged(half, ACROSS, 10, 0.5);
  const [near, far] = [at(data, 23, 20), at(data, 33, 20)];
  expect(near[3]).toBeGreaterThan(far[3] ?? 0);
  expect(far[3]).toBeGreaterThan(0);
  expect(Math.abs((near[0] ?? 0) - 200)).toBeLessThanOrEqual(2);
  expect(at(data, 25, 32)).toEqual([0, 0, 0, 0]);
});

test("less strength carries less far; less pressure smudges a narrower path", () => {
  const alpha = (opacity: number) => at(smudged(half, ACROSS, 10, opacity), 33, 20)[3] ?? 0;
  expect(alpha(0.3)).toBeLessThan(alpha(1));
  const light = ACROSS.map(([x, y]): Sample => [x, y, 0.05]);
  const beside = (samples: Sample[]) => at(smudged(half, samples), 21, 23)[3] ?? 0;
  expect(beside(ACROSS)).toBeGreaterThan(0);
  expect(beside(light)).toBe(0);
});

test("an opaque picture stays opaque, at its edge too", () => {
  const data = smudged(
    (x, y) => [6 * x, 6 * y, 90, 255],
    [
      [-8, 3, 1],
      [20, 20, 1],
      [45, 38, 1],
    ],
  );
  expect(data.filter((_, i) => i % 4 === 3).every((alpha) => alpha === 255)).toBe(true);
});

test("with a tip, a smudge has the shape of its stamps", () => {
  const smudgeWith = (tip: Tip) => {
    const { data, context } = contextOf((x) => half(x));
    const smudger = new Smudger(context, { kind: "smudge", size: 12, opacity: 1, samples: ACROSS, tip, seed: 1 });
    for (const sample of ACROSS) smudger.to(sample);
    return data;
  };
  const [round, flat] = [smudgeWith(ROUND), smudgeWith({ ...ROUND, roundness: 0.3 })];
  expect(at(round, 23, 20)[3]).toBeGreaterThan(100);
  expect(at(flat, 23, 20)[3]).toBeGreaterThan(100);
  expect(at(round, 23, 24)[3]).toBeGreaterThan(100);
  expect(at(flat, 23, 24)[3]).toBe(0);
  expect(smudgeWith(ROUND)).toEqual(round);
});

test("many short steps give the pixels of one long step", () => {
  const steps = Array.from({ length: 81 }, (_, i): Sample => [14 + i / 4, 20, 1]);
  expect(smudged(half, steps)).toEqual(smudged(half, ACROSS));
});

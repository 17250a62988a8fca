import { expect, test } from "vitest";
import type { Pattern } from "../../../src/studio/document/design";
import type { Point } from "../../../src/studio/document/document";
import * as g from "../../../src/studio/drawing/geometry";
import { floodRuns, rowsOf, runsOf, widthAt } from "../../../src/studio/drawing/strokes";

test("a fitted picture is whole and centred", () => {
  const view = g.fitView({ width: 200, height: 100 }, { width: 400, height: 400 }, 10);
  expect(view).toEqual({ scale: 1.9, x: 10, y: 105 });
});

test("zooming keeps the point under the pointer", () => {
  const view = { scale: 1, x: 30, y: 40 };
  const before = g.toPicture(view, [100, 90]);
  expect(g.toPicture(g.zoomAbout(view, [100, 90], 3), [100, 90])).toEqual(before);
  expect(g.toStage(view, g.toPicture(view, [7, 8]))).toEqual([7, 8]);
});

const SQUARE: Point[] = [
  [0, 0],
  [2, 0],
  [2, 2],
  [0, 2],
];

test("points are inside or outside of a polygon", () => {
  expect(g.contains(SQUARE, [1, 1])).toBe(true);
  expect(g.contains(SQUARE, [3, 1])).toBe(false);
  expect(Math.abs(g.area(SQUARE))).toBe(4);
});

test("simplified lines keep corners and drop points on straight parts", () => {
  const line: Point[] = [
    [0, 0],
    [1, 0.01],
    [2, 0],
    [2, 1],
    [2, 2],
  ];
  expect(g.simplify(line, 0.1)).toEqual([
    [0, 0],
    [2, 0],
    [2, 2],
  ]);
});

test("strokes circle a center and run along an arrow", () => {
  const right = g.directionAt([{ pattern: "center", at: [0.5, 0.5] }], [0.9, 0.5], 1);
  expect(right.angle).toBeCloseTo(Math.PI / 2);
  const along = g.directionAt([{ pattern: "regular", at: [0, 0], angle: 30 }], [0.7, 0.2], 1);
  expect(along.angle).toBeCloseTo(Math.PI / 6);
});

test("the angle of circles turns each stroke: at 45 degrees they are spirals, at 90 rays", () => {
  const angle = (pattern: Pattern, turn: number) =>
    g.directionAt([{ pattern, at: [0.5, 0.5], angle: turn }], [0.7, 0.6], 1).angle;
  const ray = Math.atan2(0.1, 0.2);
  expect(angle("node", 0)).toBeCloseTo(ray);
  expect(angle("center", 0)).toBeCloseTo(ray + Math.PI / 2);
  expect(angle("center", -45)).toBeCloseTo(angle("spiral", 0));
  expect(angle("node", 90)).toBeCloseTo(angle("center", 0));
});

test("a saddle rotates as a whole", () => {
  const at = (turn: number, x: number, y: number) =>
    g.directionAt([{ pattern: "saddle", at: [0.5, 0.5], angle: turn }], [x, y], 1).angle;
  expect(at(90, 0.5, 0.8)).toBeCloseTo((at(0, 0.8, 0.5) + Math.PI / 2) % Math.PI);
});

test("a fill stops at another colour", () => {
  const pixels = new Uint8ClampedArray(4 * 9);
  for (const wall of [1, 4, 7]) pixels[4 * wall] = 255;
  expect(floodRuns(pixels, { width: 3, height: 3 }, [0, 0], 10)).toEqual([0, 1, 3, 1, 6, 1]);
  expect(runsOf(new Uint8Array([0, 1, 1, 0, 1]))).toEqual([1, 2, 4, 1]);
});

test("a run of filled pixels goes on in the next rows", () => {
  const pieces = [
    [8, 0, 2],
    [0, 1, 10],
    [0, 2, 3],
    [5, 4, 1],
  ];
  expect(rowsOf([8, 15, 45, 1], 10)).toEqual(pieces);
});

test("pressure widens a stroke", () => {
  expect(widthAt(10, 1)).toBe(10);
  expect(widthAt(10, 0.1)).toBeLessThan(4);
});

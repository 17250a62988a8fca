import { expect, test } from "vitest";
import type { Pattern } from "../../../src/studio/document/design";
import type { Point } from "../../../src/studio/document/document";
import * as g from "../../../src/studio/drawing/geometry";
import { rowsOf, widthAt } from "../../../src/studio/drawing/strokes";

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

test("a turned and mirrored view keeps the point in the middle, and shows it where it is", () => {
  const size = { width: 200, height: 100 };
  const stage = { width: 400, height: 300 };
  let view = g.fitView(size, stage, 10);
  for (const change of [
    g.turnAbout(view, [200, 150], 30),
    g.mirrorAbout(g.turnAbout(view, [200, 150], 30), [200, 150]),
  ]) {
    const middle = g.toStage(change, [100, 50]);
    expect(middle[0]).toBeCloseTo(200);
    expect(middle[1]).toBeCloseTo(150);
    const [x, y] = g.toPicture(change, g.toStage(change, [7, 8]));
    expect([x, y].map((value) => Math.round(1e6 * value) / 1e6)).toEqual([7, 8]);
  }
  expect(g.toStage(g.mirrorAbout(view, [200, 150]), [0, 50])[0]).toBeCloseTo(390);
  view = g.fitView(size, stage, 10, { turn: 90 });
  expect(view.scale).toBeCloseTo(1.4);
  expect(g.toStage(view, [0, 50]).map(Math.round)).toEqual([200, 10]);
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

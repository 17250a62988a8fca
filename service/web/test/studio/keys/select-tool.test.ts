import fc from "fast-check";
import { describe, expect, it } from "vitest";
import type { Point } from "../../../src/studio/document/document";
import * as t from "../../../src/studio/drawing/transform";
import { draggedMatrix } from "../../../src/studio/keys/select-tool";

const BOX = { x: 10, y: 20, width: 30, height: 40 };
const coordinate = fc.integer({ min: -200, max: 200 });
const point = fc.tuple(coordinate, coordinate) as fc.Arbitrary<Point>;

const close = (a: readonly number[], b: readonly number[]) =>
  a.forEach((value, i) => {
    expect(value).toBeCloseTo(b[i] ?? Number.NaN, 3);
  });

describe("a drag", () => {
  it("moves by whole pixels, and back", () => {
    fc.assert(
      fc.property(point, point, (from, to) => {
        const there = draggedMatrix({ how: "move", from, matrix: t.IDENTITY, box: BOX }, to, false);
        expect(t.isShift(there)).toBe(true);
        close(draggedMatrix({ how: "move", from: to, matrix: there, box: BOX }, from, false), t.IDENTITY);
      }),
    );
  });

  it("of a corner keeps the opposite one, and takes the corner to the pointer", () => {
    const drag = { how: { handle: [1, 1] as Point }, from: [40, 60] as Point, matrix: t.IDENTITY, box: BOX };
    const matrix = draggedMatrix(drag, [70, 100], true);
    close(t.mapped(matrix, [10, 20]), [10, 20]);
    close(t.mapped(matrix, [40, 60]), [70, 100]);
    const even = draggedMatrix(drag, [70, 60], false);
    expect(even[0]).toBeCloseTo(even[3]);
  });

  it("of an edge scales along the turned box", () => {
    const turned = t.turnedAbout([25, 40], Math.PI / 2);
    const from = t.mapped(turned, [40, 40]);
    const to = t.mapped(turned, [70, 40]);
    const matrix = draggedMatrix({ how: { handle: [1, 0.5] }, from, matrix: turned, box: BOX }, to, false);
    close(t.mapped(matrix, [40, 40]), to);
    close(t.mapped(matrix, [10, 20]), t.mapped(turned, [10, 20]));
  });

  it("turns about the middle, with Shift by steps of 15 degrees", () => {
    const drag = { how: "turn" as const, from: [95, 40] as Point, matrix: t.IDENTITY, box: BOX };
    const matrix = draggedMatrix(drag, [25, 111], true);
    close(matrix, t.turnedAbout([25, 40], Math.PI / 2));
  });
});

describe("selections", () => {
  const size = { width: 40, height: 30 };

  it("of a rectangle have its pixels", () => {
    const runs = t.runsOfRectangle([12, 9], [4, 3], size);
    expect(t.boxOfRuns(runs, size)).toEqual({ x: 4, y: 3, width: 8, height: 6 });
    expect(runs.filter((_, i) => i % 2).reduce((sum, length) => sum + length, 0)).toBe(48);
  });

  it("of an outline have the pixels whose centres are inside", () => {
    const inside = (polygon: readonly Point[], x: number, y: number) => {
      let count = 0;
      polygon.forEach(([ax, ay], i) => {
        const [bx, by] = polygon[(i + 1) % polygon.length] ?? [0, 0];
        if (ay > y !== by > y && x < ax + ((y - ay) / (by - ay)) * (bx - ax)) count += 1;
      });
      return count % 2 === 1;
    };
    // corners are whole numbers and centres are halves: the sum is exact
    const onEdge = (polygon: readonly Point[], x: number, y: number) =>
      polygon.some(([ax, ay], i) => {
        const [bx, by] = polygon[(i + 1) % polygon.length] ?? [0, 0];
        return ay > y !== by > y && (bx - ax) * (y - ay) === (x - ax) * (by - ay);
      });
    const corner = fc.tuple(fc.integer({ min: 0, max: 40 }), fc.integer({ min: 0, max: 30 })) as fc.Arbitrary<Point>;
    fc.assert(
      fc.property(fc.array(corner, { minLength: 3, maxLength: 7 }), (polygon) => {
        const runs = t.runsInside(polygon, size);
        const mask = new Uint8Array(size.width * size.height);
        for (let i = 0; i < runs.length; i += 2) mask.fill(1, runs[i], (runs[i] ?? 0) + (runs[i + 1] ?? 0));
        const wrong: Point[] = [];
        for (let y = 0.5; y < size.height; y++)
          for (let x = 0.5; x < size.width; x++) {
            const selected = mask[(y - 0.5) * size.width + x - 0.5] === 1;
            // rounding decides a centre that is on an edge
            if (selected !== inside(polygon, x, y) && !onEdge(polygon, x, y)) wrong.push([x, y]);
          }
        expect(wrong).toEqual([]);
      }),
      { numRuns: 500 },
    );
  });

  it("a map and its inverse are nothing", () => {
    fc.assert(
      fc.property(point, fc.double({ min: -3, max: 3, noNaN: true }), point, (about, angle, at) => {
        const map = t.after(t.scaledAbout(about, 1.5, -0.5), t.turnedAbout(at, angle));
        close(t.mapped(t.inverse(map), t.mapped(map, at)), at);
      }),
    );
  });
});

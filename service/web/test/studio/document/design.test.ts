import { expect, test } from "vitest";
import * as design from "../../../src/studio/document/design";

test("merged regions have the tubes of both, and the second one's keys are gone", () => {
  const one: design.Design = {
    regions: { a: { tubes: [5, 1] }, b: { tubes: [1, 7] } },
    keys: [{ region: "b", frame: 0, style: "watercolor" }],
  };
  const merged = design.mergeRegions(one, ["a", "b"]);
  expect(merged.regions).toEqual({ a: { tubes: [1, 5, 7] } });
  expect(merged.keys).toEqual([]);
});

test("regions of different kinds are joined, but for two with labels", () => {
  const polygons = [{ frame: 3, points: [] }];
  const one: design.Design = {
    regions: { drawn: { polygons }, found: { objects: [2] }, map: { label: 4 }, other: { label: 5 } },
  };
  const merged = design.mergeRegions(design.mergeRegions(one, ["drawn", "found"]), ["drawn", "map"]);
  expect(merged.regions).toEqual({ drawn: { polygons, objects: [2], label: 4 }, other: { label: 5 } });
  expect(design.canMerge(merged.regions?.drawn, merged.regions?.other)).toBe(false);
  expect(design.canMerge(one.regions?.drawn, one.regions?.other)).toBe(true);
});

test("corrections go with their region", () => {
  const stroke = (region: string) => ({ region, frame: 0, points: [[0, 0]] as [number, number][], width: 0.1 });
  const one: design.Design = {
    regions: { a: { polygons: [] }, b: { polygons: [] } },
    corrections: [stroke("a"), stroke("b"), stroke("rest")],
  };
  const of = ({ corrections }: design.Design) => corrections?.map(({ region }) => region);
  expect(of(design.mergeRegions(one, ["a", "b"]))).toEqual(["a", "a", "rest"]);
  expect(of(design.removeRegion(one, "b"))).toEqual(["a", "rest"]);
  expect(of(design.renameRegion(one, "b", "c"))).toEqual(["a", "c", "rest"]);
});

test("further parts follow the first one out of a region, but for the last", () => {
  const one: design.Design = { regions: { swan: { tubes: [7, 9] }, part: { tubes: [8] } } };
  const moved = design.moveTube(one, "swan", 7, "part");
  expect(moved.regions).toEqual({ swan: { tubes: [9] }, part: { tubes: [7, 8] } });
  expect(design.moveTube(moved, "swan", 9, "part")).toBe(moved);
  expect(design.moveTube(one, "swan", 8, "part")).toBe(one);
});

test("a part that is split from a region keeps its styles", () => {
  const one: design.Design = {
    regions: { swan: { objects: [3] } },
    keys: [{ region: "swan", frame: 2, style: "watercolor" }],
  };
  const split = design.splitRegion(one, "swan", 8, "region", () => [7, 8, 9]);
  expect(split.regions).toEqual({ swan: { tubes: [7, 9] }, region: { tubes: [8] } });
  expect(split.keys?.map(({ region, style }) => [region, style])).toEqual([
    ["swan", "watercolor"],
    ["region", "watercolor"],
  ]);
  const whole = { regions: { swan: { tubes: [8] } } };
  expect(design.splitRegion(whole, "swan", 8, "region", () => [])).toBe(whole);
});

test("a renamed region keeps its place, its keys and its directions", () => {
  const one: design.Design = {
    regions: { a: { objects: [1] }, b: { objects: [2] } },
    keys: [{ region: "a", frame: 0 }],
    directions: [{ region: "a", frame: 3, elements: [] }],
  };
  const renamed = design.renameRegion(one, "a", "c");
  expect(Object.keys(renamed.regions ?? {})).toEqual(["c", "b"]);
  expect([renamed.keys?.[0]?.region, renamed.directions?.[0]?.region]).toEqual(["c", "c"]);
});

import { expect, test } from "vitest";
import * as t from "../../../src/studio/state/timeline";

test("time codes count frames within the second", () => {
  expect(t.timeCode(0, 24)).toBe("00:00:00:00");
  expect(t.timeCode(24 * 61 + 5, 24)).toBe("00:01:01:05");
  expect(t.timeCode(30, 29.97)).toBe("00:00:01:00");
});

test("every frame of the strip can be hit", () => {
  const hit = new Set(Array.from({ length: 100 }, (_, x) => t.frameAt(x, 100, [20, 27])));
  expect([...hit]).toEqual([20, 21, 22, 23, 24, 25, 26]);
  expect(t.frameAt(120, 100, [0, 10])).toBe(12);
  expect(t.shareOf(22, [20, 24])).toBe(0.5);
});

test("thumbnails are spread evenly, never more than frames", () => {
  expect(t.thumbnailFrames(4, [0, 100])).toEqual([12, 37, 62, 87]);
  expect(t.thumbnailFrames(10, [40, 43])).toEqual([40, 41, 42]);
});

test("a zoomed strip keeps the frame under the pointer, and stays within the video", () => {
  const half = t.zoomSpan([0, 1000], 1000, 0.5, 400);
  expect(half).toEqual([200, 700]);
  expect(t.shareOf(400, half)).toBe(0.4);
  expect(t.zoomSpan(half, 1000, 4, 400)).toEqual([0, 1000]);
  expect(t.zoomSpan([0, 1000], 1000, 1e-9, 999)).toEqual([988, 1000]);
  expect(t.zoomSpan([0, 5], 5, 0.1, 2)).toEqual([0, 5]);
});

test("the strip follows the playhead", () => {
  expect(t.spanWith([200, 300], 1000, 250)).toEqual([200, 300]);
  expect(t.spanWith([200, 300], 1000, 310)).toEqual([211, 311]);
  expect(t.spanWith([200, 300], 1000, 20)).toEqual([20, 120]);
  expect(t.shiftSpan([200, 300], 1000, 900)).toEqual([900, 1000]);
});

test("curves are constant outside, and eased between keys", () => {
  const keys = [
    { frame: 0, value: 0, ease: "linear" as const },
    { frame: 10, value: 10, ease: "hold" as const },
    { frame: 20, value: 30, ease: "linear" as const },
  ];
  expect([-1, 5, 10, 19, 20, 99].map((frame) => t.valueAt(keys, frame))).toEqual([0, 5, 10, 10, 30, 30]);
  expect(["linear", "smooth", "in", "out", "hold"].map((ease) => t.eased(ease as "in", 0.5))).toEqual([
    0.5, 0.5, 0.125, 0.875, 0,
  ]); // as pipeline/methods/multistyle/design.py
});

test("a hue changes the shorter way round", () => {
  const keys = [
    { frame: 0, value: 170, ease: "linear" as const },
    { frame: 10, value: -170, ease: "linear" as const },
  ];
  expect([2, 5, 8].map((frame) => t.valueAt(keys, frame, "hue"))).toEqual([174, 180, 186]);
  expect(t.valueAt(keys, 5)).toBe(0);
});

test("a style between two keys has the values of its time", () => {
  const track = [
    { region: "rest", frame: 10, style: "colorist-wash", set: { size: 10, hue: 170, soft: 3 }, ease: "in" as const },
    { region: "rest", frame: 20, set: { size: 90, hue: -170 } },
  ];
  expect(t.styleAt(track, 15)).toEqual({ ...track[0], set: { size: 20, hue: 172.5, soft: 3 } });
  expect(t.styleAt(track, 18)?.set?.hue).toBeCloseTo(-179.76);
  expect([0, 10, 20, 30].map((frame) => t.styleAt(track, frame)?.frame)).toEqual([10, 10, 20, 20]);
  expect(t.styleAt(track, 30)).toBe(track[1]);
  expect(t.styleAt([], 3)).toBeUndefined();
});

test("J and L double their speed, K stops", () => {
  expect(["l", "l", "l", "l", "l"].reduce((speed, key) => t.shuttle(speed, key as "l"), 0)).toBe(8);
  expect(t.shuttle(4, "j")).toBe(-1);
  expect(t.shuttle(4, "k")).toBe(0);
});

test("keys before and after a frame", () => {
  expect(t.nextKey([3, 9], 3)).toBe(9);
  expect(t.previousKey([3, 9], 9)).toBe(3);
  expect(t.nextKey([3, 9], 9)).toBeUndefined();
});

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
  const half = t.zoomSpan([0, 1000], [0, 1000], 0.5, 400);
  expect(half).toEqual([200, 700]);
  expect(t.shareOf(400, half)).toBe(0.4);
  expect(t.zoomSpan(half, [0, 1000], 4, 400)).toEqual([0, 1000]);
  expect(t.zoomSpan([0, 1000], [0, 1000], 1e-9, 999)).toEqual([988, 1000]);
  expect(t.zoomSpan([0, 5], [0, 5], 0.1, 2)).toEqual([0, 5]);
});

test("the strip follows the playhead", () => {
  expect(t.spanWith([200, 300], [0, 1000], 250)).toEqual([200, 300]);
  expect(t.spanWith([200, 300], [0, 1000], 310)).toEqual([211, 311]);
  expect(t.spanWith([200, 300], [0, 1000], 20)).toEqual([20, 120]);
  expect(t.shiftSpan([200, 300], [0, 1000], 900)).toEqual([900, 1000]);
});

test("the strip and the playhead stay within the frames of the shot", () => {
  expect(t.spanWith([40, 60], [40, 80], 75)).toEqual([56, 76]);
  expect(t.zoomSpan([40, 60], [40, 80], 9, 50)).toEqual([40, 80]);
  expect(t.shiftSpan([50, 60], [40, 80], -90)).toEqual([40, 50]);
  expect([-5, 60.4, 99].map((frame) => t.clampFrame(frame, [40, 80]))).toEqual([40, 60, 79]);
});

test("easings are those of the film", () => {
  expect(["linear", "smooth", "in", "out", "hold"].map((ease) => t.eased(ease as "in", 0.5))).toEqual([
    0.5, 0.5, 0.125, 0.875, 0,
  ]); // as pipeline/methods/multistyle/design.py
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

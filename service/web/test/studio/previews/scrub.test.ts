import { expect, test } from "vitest";
import { missingRun } from "../../../src/studio/previews/scrub";

const known = (...frames: number[]) => new Set(frames);

test("the next run begins with the first missing frame in the direction of the movement", () => {
  const there = known(10, 11, 12);
  expect(missingRun((frame) => there.has(frame), 10, 1, 100)).toEqual([13, 37]);
  expect(missingRun((frame) => there.has(frame), 12, -1, 100)).toEqual([0, 10]);
});

test("runs end with the film, and nothing is asked for while the next frames are known", () => {
  expect(missingRun(() => false, 90, 1, 100)).toEqual([90, 100]);
  expect(missingRun(() => true, 50, 1, 100)).toBeNull();
  expect(missingRun((frame) => frame > 95, 96, 1, 100)).toBeNull();
});

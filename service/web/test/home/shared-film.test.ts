import { expect, test } from "vitest";
import { frameAtSecond, secondOfFrame } from "../../src/home/shared-film";

const chapters = [
  { shot: "a", name: "One", first: 5, frames: 10, fps: 12, start_s: 0 },
  { shot: "b", name: "Two", first: 0, frames: 24, fps: 24, start_s: 0.833333 },
];

test("every frame is found at its own second, also where a shot begins within its clip", () => {
  for (const { shot, first, frames } of chapters)
    for (let frame = first; frame < first + frames; frame++) {
      const found = frameAtSecond(chapters, secondOfFrame(chapters, shot, frame) ?? -1);
      expect([found?.chapter.shot, found?.frame]).toEqual([shot, frame]);
    }
});

test("what the film does not have has no second, and times beyond it show its ends", () => {
  expect(secondOfFrame(chapters, "a", 4)).toBeUndefined();
  expect(secondOfFrame(chapters, "a", 15)).toBeUndefined();
  expect(secondOfFrame(chapters, "gone", 0)).toBeUndefined();
  expect(frameAtSecond(chapters, 99)?.frame).toBe(23);
  expect(frameAtSecond([], 1)).toBeNull();
});

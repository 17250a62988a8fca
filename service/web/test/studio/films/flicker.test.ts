import { expect, test } from "vitest";
import { heatColour, worstFrames } from "../../../src/studio/films/flicker";

test("the worst frames have the largest errors, and come in the order of time", () => {
  const errors = [0.1, 0.4, 0, 0.3, 0.2];
  const measured = new Map(errors.map((error, frame) => [frame, { flicker: 1, error }]));
  measured.set(9, { flicker: 0, error: 0 });
  expect(worstFrames(measured)).toEqual([1, 3, 4]);
  expect(worstFrames(new Map([[3, { flicker: null, error: null }]]))).toEqual([]);
});

test("a pixel without flicker is transparent, and one with the most is red", () => {
  expect(heatColour(0)[3]).toBe(0);
  expect(heatColour(255)).toEqual([255, 0, 0, 230]);
});

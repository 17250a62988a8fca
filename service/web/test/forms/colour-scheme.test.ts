import { expect, test } from "vitest";
import { drawn, HUES, schemeOf } from "../../src/forms/colour-scheme";

const pixels = (...colours: number[][]) => new Uint8ClampedArray(colours.flatMap((rgb) => [...rgb, 255]));

test("hues are counted in bins of ten degrees about their middle, where they mean something", () => {
  const found = schemeOf([
    pixels([255, 0, 0], [255, 12, 0], [255, 0, 15]),
    pixels([0, 0, 200], [128, 128, 128], [9, 0, 0]),
  ]);
  expect(found?.hue[0]).toBe(1);
  expect(found?.hue[24]).toBe(0.333);
  expect(found?.hue.filter((weight) => weight > 0)).toHaveLength(2);
  expect(found?.saturation_mean).toBe(0.8); // of the five pixels that are not dark
  expect(found?.saturation_std).toBe(0.4);
  expect(found?.value_mean).toBe(0.72);
  expect(schemeOf([pixels([128, 128, 128])])).toBe(null);
});

test("a stroke sets every bin that it passes, and never clears the last one", () => {
  const none: number[] = Array(HUES).fill(0);
  const rising = drawn(none, [0.5 / HUES, 0], [4.5 / HUES, 1]);
  expect(rising.slice(0, 6)).toEqual([0, 0.25, 0.5, 0.75, 1, 0]);
  expect(drawn(rising, [2, 3], [0.97, 2])[HUES - 1]).toBe(1);
  expect(drawn(rising, [0, -1], [1, -1])).toEqual(rising);
});

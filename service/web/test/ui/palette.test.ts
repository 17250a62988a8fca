/** Colours of a picture, and their forms. */

import fc from "fast-check";
import { expect, test } from "vitest";
import { rgbOf } from "../../src/studio/drawing/stroke-mask";
import { hexOf, hsvOf, mainColours, rgbOfHsv } from "../../src/ui/palette";

test("hue, saturation and value give the colour back", () => {
  const channel = fc.integer({ min: 0, max: 255 });
  fc.assert(
    fc.property(fc.tuple(channel, channel, channel), (rgb) => {
      expect(rgbOfHsv(hsvOf(rgb))).toEqual(rgb);
      expect(rgbOf(hexOf(rgb))).toEqual(rgb);
    }),
  );
});

test("the main colours of a picture are those of its areas, dark ones first; what is transparent is none", () => {
  const areas = [
    [200, 30, 40, 255],
    [20, 30, 90, 255],
    [240, 230, 200, 255],
    [0, 255, 0, 0],
  ];
  const data = new Uint8ClampedArray(areas.flatMap((area) => Array.from({ length: 500 }, () => area)).flat());
  expect(mainColours(data, 8)).toEqual(["#141e5a", "#c81e28", "#f0e6c8"]);
  expect(mainColours(new Uint8ClampedArray(4), 8)).toEqual([]);
});

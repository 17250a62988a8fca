import { expect, test } from "vitest";
import { trendPoints } from "../../src/ops/machine";

test("a trend runs from left to right, full load at the top, and stays within the picture", () => {
  expect(trendPoints([0, 1, 0.5])).toBe("0.0,35.0 120.0,1.0 240.0,18.0");
  expect(trendPoints([-1, 2])).toBe("0.0,35.0 240.0,1.0");
});

import fc from "fast-check";
import { expect, it } from "vitest";
import { placed } from "../../../src/studio/keys/scaling";

const size = fc.record({ width: fc.integer({ min: 1, max: 4000 }), height: fc.integer({ min: 1, max: 4000 }) });

it("a fitted picture is within the frame and touches two of its sides; a filling one covers it", () => {
  fc.assert(
    fc.property(size, size, (picture, frame) => {
      const fit = placed(picture, frame, "fit");
      expect(fit.width <= frame.width && fit.height <= frame.height).toBe(true);
      expect(fit.width === frame.width || fit.height === frame.height).toBe(true);
      const fill = placed(picture, frame, "fill");
      expect(fill.x <= 0 && fill.y <= 0).toBe(true);
      expect(fill.x + fill.width >= frame.width && fill.y + fill.height >= frame.height).toBe(true);
    }),
  );
});

it("a picture of the frame's size stays as it is, however it is scaled", () => {
  const frame = { width: 64, height: 36 };
  for (const scaling of ["fit", "fill", "stretch", "exact"] as const)
    expect(placed(frame, frame, scaling)).toEqual({ x: 0, y: 0, ...frame });
  expect(placed({ width: 10, height: 50 }, frame, "stretch")).toEqual({ x: 0, y: 0, ...frame });
  expect(placed({ width: 10, height: 50 }, frame, "exact")).toEqual({ x: 27, y: -7, width: 10, height: 50 });
});

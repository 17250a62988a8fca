/** Brushes from files. */

import { expect, test } from "vitest";
import { paintOf, presetsOf } from "../../../src/studio/drawing/brush-files";
import { coverageIn, pictureOf, TIP_PX, tipPicture } from "../../../src/studio/drawing/tip-picture";

test("the opaque pixels of a picture are paint, of one without transparency the dark ones", () => {
  expect([...paintOf(new Uint8ClampedArray([0, 0, 0, 0, 255, 255, 255, 200]))]).toEqual([0, 200]);
  expect([...paintOf(new Uint8ClampedArray([255, 255, 255, 255, 0, 0, 0, 255]))]).toEqual([0, 255]);
});

test("a stamp is cut to its paint and made small enough to travel with strokes", () => {
  const paint = new Uint8Array(400 * 400);
  for (let y = 100; y < 300; y++) paint.fill(255, 400 * y + 50, 400 * y + 350);
  const level = pictureOf(tipPicture(400, 400, paint)).for(1000);
  expect([level.width, level.height]).toEqual([75, 50]);
  expect(Math.max(level.width, level.height)).toBeLessThanOrEqual(TIP_PX);
  expect(coverageIn(level, 0, 0)).toBe(1);
  expect(coverageIn(level, 0, 0.9)).toBe(0);
  expect(() => tipPicture(4, 4, new Uint8Array(16))).toThrow("no paint");
});

test("round and sampled brushes of Photoshop are read with their spacing, angle, scatter and pressure to size", () => {
  const dynamics = { control: "off" as const, steps: 0, jitter: 0, minimum: 0 };
  const shared = { size: 30, angle: 20, roundness: 0.5, spacingOn: true, spacing: 0.4, flipX: false, flipY: false };
  const brush = { noise: false, wetEdges: false, spacing: 0.4, useBrushSize: true };
  const shapeDynamics = {
    sizeDynamics: { ...dynamics, control: "pen pressure" as const, jitter: 0.1 },
    minimumDiameter: 0.2,
    tiltScale: 2,
    angleDynamics: dynamics,
    roundnessDynamics: dynamics,
    minimumRoundness: 0,
    flipX: false,
    flipY: false,
    brushProjection: false,
  };
  const scatter = { bothAxes: true, scatterDynamics: { ...dynamics, jitter: 0.3 }, countDynamics: dynamics, count: 1 };
  const sample = { id: "leaf", bounds: { x: 0, y: 0, w: 2, h: 2 }, alpha: new Uint8Array([255, 0, 0, 255]) };
  const found = presetsOf({
    brushes: [
      { ...brush, name: "Soft", shape: { type: "computed", hardness: 0.3, ...shared }, shapeDynamics },
      { ...brush, name: "Leaf", shape: { type: "sampled", name: "leaf", sampledData: "leaf", ...shared }, scatter },
      { ...brush, name: "Lost", shape: { type: "sampled", name: "lost", sampledData: "lost", ...shared } },
    ],
    samples: [sample],
  });
  expect(found.map(({ name, size }) => [name, size])).toEqual([
    ["Soft", 30],
    ["Leaf", 30],
  ]);
  const [soft, leaf] = found.map(({ tip }) => tip);
  expect(soft).toMatchObject({
    shape: "round",
    hardness: 0.3,
    roundness: 0.5,
    angle: 20,
    spacing: 0.4,
    sizeJitter: 0.1,
  });
  expect(soft?.size.pressure).toEqual([0.2, 0.6, 1]);
  expect(leaf).toMatchObject({ shape: "picture", scatter: 0.3 });
  expect(pictureOf(leaf?.picture ?? "").for(2).width).toBe(2);
});

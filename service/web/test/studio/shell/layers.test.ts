import { expect, test } from "vitest";
import type { Layer } from "../../../src/studio/document/document";
import { swapped } from "../../../src/studio/shell/layers-section";

test("a layer moves one place towards the front", () => {
  const layers: Layer[] = ["a", "b", "c"].map((id) => ({ id, method: "analogy" }));
  expect(swapped(layers, "a").map((layer) => layer.id)).toEqual(["b", "a", "c"]);
  expect(swapped(layers, "c").map((layer) => layer.id)).toEqual(["a", "b", "c"]);
});

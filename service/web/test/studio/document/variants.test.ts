import { expect, test } from "vitest";
import type { Layer, Variant } from "../../../src/studio/document/document";
import { cardsOf, completedSet, paramsOf } from "../../../src/studio/document/variant-patch";

const variant: Variant = {
  id: "v1",
  name: "Soft",
  shot: "s1",
  layer: "l1",
  set: { method: "abstraction", params: { lines: "off", vividness: null } },
  frame: 4,
};
const layer: Layer = { id: "l1", method: "abstraction", params: { lines: "flow", line_width: 3 } };

test("a variant has exactly its own parameters, whatever the layer has", () => {
  expect(paramsOf(variant)).toEqual({ lines: "off" });
  expect(completedSet(variant, layer)).toEqual({ method: "abstraction", params: { lines: "off", line_width: null } });
  expect(completedSet(variant, { ...layer, params: {} }).params).toEqual({ lines: "off" });
  expect(cardsOf([variant], layer)).toEqual([{ id: "v1", set: completedSet(variant, layer) }]);
});

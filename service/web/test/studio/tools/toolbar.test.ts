import { expect, test } from "vitest";
import type { Store } from "../../../src/studio/state/store";
import { toolsOf } from "../../../src/studio/tools/toolbar";

const storeOf = (tools?: string[], editor?: string) =>
  ({ method: { value: tools && { studio: { tools } } }, painted: () => editor && { editor } }) as unknown as Store;

test("the toolbar has the tools that the method names, and those that need a search only after it", () => {
  const store = storeOf(["brush", "label", "region"]);
  expect(toolsOf(store, true, true)).toEqual(["pan", "brush", "label", "region"]);
  expect(toolsOf(store, false, false)).toEqual(["pan", "brush"]);
  expect(toolsOf(storeOf([]), true, true)).toEqual(["pan"]);
  expect(toolsOf(storeOf(), true, true)).toEqual(["pan"]);
});

test("painted keys, not marks, have the tools that select and move", () => {
  expect(toolsOf(storeOf(["brush"], "keys"), true, true)).toEqual([
    "pan",
    "brush",
    "rectangle",
    "outline",
    "transform",
  ]);
  expect(toolsOf(storeOf(["brush"], "marks"), true, true)).toEqual(["pan", "brush"]);
});

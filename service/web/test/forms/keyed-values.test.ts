import { expect, test } from "vitest";
import { applies } from "../../src/forms/applies";
import { keysOf, paramsAt, valueAt, withKey, withoutKey } from "../../src/forms/keyed-values";
import { fieldsOf } from "../../src/forms/schema";

const KEYS = [
  [10, 1],
  [20, 3],
] as const;

test("a number is linear between keys and constant outside", () => {
  expect([0, 10, 12, 20, 99].map((frame) => valueAt(KEYS, frame))).toEqual([1, 1, 1.4, 3, 3]);
  expect(paramsAt({ a: KEYS, b: 2, palette: ["#000000"] }, 15)).toEqual({ a: 2, b: 2, palette: ["#000000"] });
});

test("keys are added in order, changed, and removed down to one number", () => {
  expect(withKey(KEYS, 15, 9)).toEqual([KEYS[0], [15, 9], KEYS[1]]);
  expect(withKey(KEYS, 20, 9)).toEqual([KEYS[0], [20, 9]]);
  expect(withoutKey(KEYS, 10)).toEqual([KEYS[1]]);
  expect(withoutKey([[10, 1]], 10)).toBe(1);
});

test("a number that may vary has a slider, and counts with its largest value", () => {
  const varying = { type: ["number", "array"], minimum: 0, maximum: 2, default: 1, maxItems: 9, varies: true };
  const [field] = fieldsOf({ properties: { a: varying, b: { type: "number" } } });
  expect([field?.kind, field?.varies, keysOf([[0, 1]]), keysOf(["#000000"]), keysOf([])]).toEqual([
    "slider",
    true,
    [[0, 1]],
    undefined,
    undefined,
  ]);
  expect(applies([{ above: { a: 2 } }], { a: KEYS }, {})).toBe(true);
  expect(applies([{ above: { a: 3 } }], { a: KEYS }, {})).toBe(false);
});

import { expect, test } from "vitest";
import type { Schema } from "../../src/api/schemas";
import { fieldsOf, snap } from "../../src/forms/schema";

const SCHEMA: Schema = {
  $defs: { Kind: { enum: ["a", "b"], type: "string" } },
  properties: {
    plain: { type: "number" },
    low: { type: "number", minimum: 0, maximum: 1000, default: 10 },
    whole: { type: "integer", exclusiveMinimum: 0, maximum: 8, default: 4 },
    kind: { $ref: "#/$defs/Kind", default: "b", title: "Which" },
    flag: { enum: ["on", "off"], default: "on" },
    maybe: { anyOf: [{ type: "integer" }, { type: "null" }], default: null },
    many: { type: "array", items: { $ref: "#/$defs/Kind" }, default: [] },
    odd: { type: "object" },
    ink: { type: "string", format: "color", default: "#000000" },
    inks: { type: "array", items: { type: "string" }, format: "colors", maxItems: 3, default: [] },
  },
};

const fields = Object.fromEntries(fieldsOf(SCHEMA).map((field) => [field.name, field]));

test("each type of property has its kind of control", () => {
  const kinds = Object.fromEntries(Object.values(fields).map(({ name, kind }) => [name, kind]));
  expect(kinds).toEqual({
    plain: "number",
    low: "slider",
    whole: "slider",
    kind: "choice",
    flag: "onoff",
    maybe: "number",
    many: "choices",
    odd: "json",
    ink: "colour",
    inks: "colours",
  });
});

test("exclusive limits, references and null are resolved", () => {
  expect(fields.whole?.min).toBe(1);
  expect(fields.inks?.most).toBe(3);
  expect(fields.kind?.title).toBe("Which");
  expect(fields.maybe?.nullable).toBe(true);
});

test("only a default low in its range bends the slider", () => {
  expect(fields.low?.curve).toBeGreaterThan(1);
  expect(fields.whole?.curve).toBe(1);
});

test("values are rounded to the step without binary errors", () => {
  expect(snap(0.1 + 0.2, { step: 0.1, min: 0 })).toBe(0.3);
});

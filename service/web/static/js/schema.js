/** JSON Schema, as pydantic writes it, made into plain descriptions of form fields. */

import { humanise } from "./format.js";

/**
 * @typedef {object} Field
 * @property {string} name, title, help, unit, symbol, group
 * @property {"slider"|"number"|"switch"|"onoff"|"choice"|"choices"|"text"|"json"} kind
 * @property {*} initial the default
 * @property {{value: *, title: string}[]} options of a choice
 * @property {boolean} whole whether numbers are integers
 * @property {number} curve of a slider: value = min + (max - min) * position ** curve, so that the default is in reach
 * @property {boolean} nullable whether it may be left empty
 */

/** The fields of an object schema, in its order. */
export function fieldsOf(schema) {
  const defs = schema.$defs ?? {};
  return Object.entries(schema.properties ?? {}).map(([name, property]) => field(name, resolve(property, defs), defs));
}

/** Follow `$ref`, a lone `allOf`, and `anyOf` with null; what stands beside a reference wins over what it refers to. */
function resolve(property, defs) {
  const { $ref, allOf, anyOf, ...own } = property;
  if ($ref) return { ...resolve(defs[$ref.split("/").pop()], defs), ...own };
  if (allOf?.length === 1) return { ...resolve(allOf[0], defs), ...own };
  const options = anyOf?.filter((option) => option.type !== "null") ?? [];
  if (options.length === 1) return { ...resolve(options[0], defs), ...own, nullable: options.length < anyOf.length };
  return property;
}

function field(name, schema, defs) {
  const [min, max] = bounds(schema);
  const curve = curveOf(schema, min, max);
  const common = {
    name,
    title: schema.title ?? humanise(name),
    help: schema.description ?? "",
    unit: schema.unit ?? "",
    symbol: schema.symbol ?? "",
    group: schema.group ?? "",
    initial: schema.default ?? (schema.nullable ? null : undefined),
    nullable: Boolean(schema.nullable),
    whole: schema.type === "integer",
    curve,
  };
  return { ...common, min, max, step: stepOf(schema, min, max, curve), options: optionsOf(schema, defs), kind: kindOf(schema, min, max, defs) };
}

function bounds(schema) {
  const nudge = schema.type === "integer" ? 1 : 0;
  const min = schema.minimum ?? (schema.exclusiveMinimum === undefined ? undefined : schema.exclusiveMinimum + nudge);
  const max = schema.maximum ?? (schema.exclusiveMaximum === undefined ? undefined : schema.exclusiveMaximum - nudge);
  return [min, max];
}

/** Above 1 where the default lies low in its range: it is then drawn near the middle of the slider. */
function curveOf(schema, min, max) {
  const share = (schema.default - min) / (max - min);
  return share > 0 && share < 0.3 ? Math.min(3, Math.log(share) / Math.log(0.4)) : 1;
}

/** A round step, about a hundredth of the range or finer on a curve: 1, 2 or 5 times a power of ten. */
function stepOf(schema, min, max, curve) {
  if (schema.multipleOf) return schema.multipleOf;
  if (schema.type === "integer") return 1;
  if (min === undefined || max === undefined) return "any";
  const rough = (max - min) / (curve > 1 ? 500 : 100);
  const power = 10 ** Math.floor(Math.log10(rough));
  return power * ([1, 2, 5].find((digit) => digit * power >= rough * 0.999) ?? 10);
}

function optionsOf(schema, defs) {
  const source = schema.type === "array" ? resolve(schema.items ?? {}, defs) : schema;
  if (source.enum) return source.enum.map((value) => ({ value, title: humanise(value) }));
  const consts = (source.oneOf ?? source.anyOf ?? []).filter((option) => "const" in option);
  if (consts.length) return consts.map((option) => ({ value: option.const, title: option.title ?? humanise(option.const) }));
  return "const" in source ? [{ value: source.const, title: humanise(source.const) }] : [];
}

function kindOf(schema, min, max, defs) {
  if (schema.type === "array") return optionsOf(schema, defs).length ? "choices" : "json";
  if (isOnOff(optionsOf(schema, defs))) return "onoff";
  if (optionsOf(schema, defs).length) return "choice";
  if (schema.type === "boolean") return "switch";
  if (schema.type === "string") return "text";
  if (schema.type !== "number" && schema.type !== "integer") return "json";
  return min === undefined || max === undefined || schema.nullable ? "number" : "slider";
}

const isOnOff = (options) => options.length === 2 && ["on", "off"].every((word) => options.some((o) => o.value === word));

/** Round to the step of the field, without the dust of binary fractions. */
export function snap(value, { step, min = 0 }) {
  if (step === "any") return value;
  const digits = Math.max(0, Math.ceil(-Math.log10(step)) + 1);
  return Number((min + Math.round((value - min) / step) * step).toFixed(digits));
}

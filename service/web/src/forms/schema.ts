/** JSON Schema, as pydantic writes it, made into plain descriptions of form fields. */

import type { Schema, When } from "../api/schemas";
import { humanise } from "../ui/format";

export type FieldKind =
  | "slider"
  | "number"
  | "switch"
  | "onoff"
  | "choice"
  | "choices"
  | "text"
  | "json"
  | "colour"
  | "colours";

interface Option {
  value: unknown;
  title: string;
}

export interface Field {
  name: string;
  title: string;
  help: string;
  unit: string;
  /** The paper's symbol, for example "sigma_e". */
  symbol: string;
  group: string;
  /** When the field has an effect: alternatives; none: always. */
  appliesWhen: When[];
  kind: FieldKind;
  /** The default; undefined if the schema has none. */
  initial: unknown | undefined;
  options: Option[];
  /** Whether numbers are integers. */
  whole: boolean;
  /** Exponent of a slider: value = min + (max - min) * position ** curve, so that the default is in reach. */
  curve: number;
  /** Whether the field may be left empty. */
  nullable: boolean;
  min: number | undefined;
  max: number | undefined;
  step: number | "any";
  /** Whether it may have values over time, see `keyed-values`. */
  varies: boolean;
  /** Greatest number of items of a list. */
  most: number | undefined;
}

type Definitions = Record<string, Schema>;

/** The fields of an object schema, in its order. */
export function fieldsOf(schema: Schema): Field[] {
  const defs = schema.$defs ?? {};
  return Object.entries(schema.properties ?? {}).map(([name, property]) => field(name, resolve(property, defs), defs));
}

/** Follow `$ref`, a lone `allOf`, and `anyOf` with null; keywords beside a reference win over those it refers to. */
function resolve(property: Schema, defs: Definitions): Schema {
  const { $ref, allOf, anyOf, ...own } = property;
  if ($ref) return { ...resolve(defs[$ref.split("/").pop() ?? ""] ?? {}, defs), ...own };
  if (allOf?.length === 1) return { ...resolve(allOf[0] ?? {}, defs), ...own };
  const options = anyOf?.filter((option) => option.type !== "null") ?? [];
  if (anyOf && options.length === 1) {
    return { ...resolve(options[0] ?? {}, defs), ...own, nullable: options.length < anyOf.length };
  }
  return property;
}

function field(name: string, given: Schema, defs: Definitions): Field {
  const schema = given.varies ? { ...given, type: "number" } : given;
  const { min, max } = bounds(schema);
  const curve = curveOf(schema, min, max);
  return {
    name,
    title: schema.title ?? humanise(name),
    help: schema.description ?? "",
    unit: schema.unit ?? "",
    symbol: schema.symbol ?? "",
    group: schema.group ?? "",
    appliesWhen: schema.applies_when ?? [],
    initial: schema.default ?? (schema.nullable ? null : undefined),
    nullable: Boolean(schema.nullable),
    whole: schema.type === "integer",
    curve,
    min,
    max,
    step: stepOf(schema, min, max, curve),
    varies: Boolean(schema.varies),
    most: schema.maxItems,
    options: optionsOf(schema, defs),
    kind: kindOf(schema, min, max, defs),
  };
}

type Bound = number | undefined;

function bounds(schema: Schema): { min: Bound; max: Bound } {
  const nudge = schema.type === "integer" ? 1 : 0;
  const min = schema.minimum ?? (schema.exclusiveMinimum === undefined ? undefined : schema.exclusiveMinimum + nudge);
  const max = schema.maximum ?? (schema.exclusiveMaximum === undefined ? undefined : schema.exclusiveMaximum - nudge);
  return { min, max };
}

/** Above 1 where the default lies low in its range: it is then drawn near the middle of the slider. */
function curveOf(schema: Schema, min: Bound, max: Bound): number {
  if (typeof schema.default !== "number" || min === undefined || max === undefined) return 1;
  const share = (schema.default - min) / (max - min);
  return share > 0 && share < 0.3 ? Math.min(3, Math.log(share) / Math.log(0.4)) : 1;
}

/** A round step, about a hundredth of the range or finer on a curve: 1, 2 or 5 times a power of ten. */
function stepOf(schema: Schema, min: Bound, max: Bound, curve: number): number | "any" {
  if (schema.multipleOf) return schema.multipleOf;
  if (schema.type === "integer") return 1;
  if (min === undefined || max === undefined) return "any";
  const rough = (max - min) / (curve > 1 ? 500 : 100);
  const power = 10 ** Math.floor(Math.log10(rough));
  return power * ([1, 2, 5].find((digit) => digit * power >= rough * 0.999) ?? 10);
}

function optionsOf(schema: Schema, defs: Definitions): Option[] {
  const source = schema.type === "array" ? resolve(schema.items ?? {}, defs) : schema;
  if (source.enum) return source.enum.map((value) => ({ value, title: humanise(String(value)) }));
  const given = source.oneOf ?? source.anyOf ?? ("const" in source ? [source] : []);
  return given.flatMap((option) =>
    option.const === undefined ? [] : [{ value: option.const, title: option.title ?? humanise(String(option.const)) }],
  );
}

function kindOf(schema: Schema, min: Bound, max: Bound, defs: Definitions): FieldKind {
  const options = optionsOf(schema, defs);
  if (schema.format === "color") return "colour";
  if (schema.format === "colors") return "colours";
  if (schema.type === "array") return options.length ? "choices" : "json";
  if (isOnOff(options)) return "onoff";
  if (options.length) return "choice";
  if (schema.type === "boolean") return "switch";
  if (schema.type === "string") return "text";
  if (schema.type !== "number" && schema.type !== "integer") return "json";
  return min === undefined || max === undefined || schema.nullable ? "number" : "slider";
}

const isOnOff = (options: Option[]): boolean =>
  options.length === 2 && ["on", "off"].every((word) => options.some((option) => option.value === word));

/** Round to the step of the field, without the rounding errors of binary fractions. */
export function snap(value: number, { step, min = 0 }: Pick<Field, "step" | "min">): number {
  if (step === "any") return value;
  const digits = Math.max(0, Math.ceil(-Math.log10(step)) + 1);
  return Number((min + Math.round((value - min) / step) * step).toFixed(digits));
}

/** Styles of regions as numbers: between two keys they change as the film changes them. Pure functions. */

import type { Params, Schemas, Section } from "../../api/schemas";
import { paramsAt } from "../../forms/keyed-values";
import { type Design, type OwnStyle, type StyleKey, trackOf } from "../document/design";
import { freeName } from "../document/document";
import { eased } from "../state/timeline";

type Slider = Schemas["Slider"];
export type Numbers = Readonly<Record<string, number>>;

/** A style in full: the numbers that sliders set, and those that they do not. */
export interface Style {
  values: Numbers;
  technique: Numbers;
}

/** What styles are made from: the section that describes them, the region's design, and all parameters of the layer. */
export interface StyleContext {
  section: Section;
  design: Design;
  params: Params;
}

/** The style of a key; without one, the layer's own. */
export function styleOf(context: StyleContext, key?: StyleKey): Style {
  const base = styleBelow(context, key?.style);
  return { ...base, values: { ...base.values, ...numbersIn(key?.set) } };
}

/** The style that a key names, without the changes of the key. */
export function styleBelow(context: StyleContext, name: string | undefined): Style {
  const own = name === undefined ? undefined : context.design.styles?.[name];
  const base = named(context, own ? own.base : name) ?? layerStyle(context);
  if (!own) return base;
  const { technique, ...values } = own;
  return {
    values: { ...base.values, ...numbersIn(values) },
    technique: { ...base.technique, ...numbersIn(technique) },
  };
}

const named = ({ section }: StyleContext, name: string | null | undefined): Style | undefined => {
  const found = section.styles.find(({ value }) => value === name);
  return found && { values: found.values ?? {}, technique: found.technique ?? {} };
};

const numbersIn = (members: object = {}): Numbers =>
  Object.fromEntries(Object.entries(members).filter(([, value]) => typeof value === "number"));

/** The style that the layer's parameters make: that of regions without a key. */
function layerStyle(context: StyleContext): Style {
  const { section, params } = context;
  const base = named(context, String(params[section.style_param])) ?? { values: {}, technique: {} };
  const values = Object.fromEntries(
    section.sliders.map((slider) => [slider.name, adjusted(slider, base.values[slider.name] ?? 0, params)]),
  );
  return { ...base, values };
}

function adjusted({ param, by, circular, minimum, maximum }: Slider, value: number, params: Params): number {
  const amount = param ? params[param] : undefined;
  if (typeof amount !== "number") return value;
  const changed = by === "factor" ? value * amount : value + amount;
  return circular ? wrapped(changed) : Math.min(maximum, Math.max(minimum, changed));
}

/** An angle in degrees, -180 <= angle < 180. */
const wrapped = (angle: number): number => angle - 360 * Math.floor((angle + 180) / 360);

/** Two keys around a frame and the share of the second, 0..1; outside of all keys, both are the nearest one. */
export function keysAround(track: readonly StyleKey[], frame: number): [StyleKey, StyleKey, number] | undefined {
  const before = track.findLast((key) => key.frame <= frame);
  const after = track.find((key) => key.frame > frame);
  const only = before ?? after;
  if (!before || !after) return only && [only, only, 0];
  return [before, after, eased(before.ease ?? "linear", (frame - before.frame) / (after.frame - before.frame))];
}

/** The context with the layer's parameters as they are at a frame. */
export const contextAt = (context: StyleContext, frame: number): StyleContext => ({
  ...context,
  params: paramsAt(context.params, frame),
});

/** The style of a region at a frame, as the film has it; undefined without a key of the region. */
export function styleAt(context: StyleContext, region: string, frame: number): Style | undefined {
  const around = keysAround(trackOf(context.design.keys, region), frame);
  if (!around) return undefined;
  const [before, after, t] = around;
  const now = contextAt(context, frame);
  const [one, other] = [styleOf(now, before), styleOf(now, after)];
  const turning = new Set(context.section.sliders.filter(({ circular }) => circular).map(({ name }) => name));
  return {
    values: mixed(one.values, other.values, t, turning),
    technique: mixed(one.technique, other.technique, t),
  };
}

function mixed(one: Numbers, other: Numbers, t: number, turning: ReadonlySet<string> = new Set()): Numbers {
  const entries = Object.entries(one).map(([name, value]): [string, number] => {
    const difference = (other[name] ?? value) - value;
    if (!turning.has(name)) return [name, value + t * difference];
    const shorter = Math.abs(difference) > 180 ? difference - 360 * Math.sign(difference) : difference;
    const turned = value + t * shorter;
    return [name, Math.abs(turned) > 180 ? turned - 360 * Math.sign(turned) : turned];
  });
  return Object.fromEntries(entries);
}

/** Start of the names of styles that `keyHere` makes. */
const MIX = "mix";

/**
 * The key of a region at a frame. If there is none, a new one with the values of this time; between two styles it has a
 * style of its own, which `styles` then contains. Undefined without a key of the region.
 */
export function keyHere(
  context: StyleContext,
  region: string,
  frame: number,
): { key: StyleKey; styles: Design["styles"] } | undefined {
  const { design } = context;
  const around = keysAround(trackOf(design.keys, region), frame);
  const style = styleAt(context, region, frame);
  if (!around || !style) return undefined;
  const [before, , t] = around;
  const key = { ...before, region, frame };
  if (t === 0) return { key, styles: design.styles };
  const base = styleBelow(contextAt(context, frame), before.style);
  if (same(base.technique, style.technique)) {
    const set = Object.entries(style.values).filter(
      ([name, value]) => value !== base.values[name] || before.set?.[name] !== undefined,
    );
    return { key: { ...key, set: rounded(set) }, styles: design.styles };
  }
  const name = freeName(MIX, (taken) => taken in (design.styles ?? {}));
  const own: OwnStyle = {
    ...rounded(Object.entries(style.values)),
    technique: rounded(Object.entries(style.technique)),
  };
  return { key: { ...key, style: name, set: {} }, styles: { ...design.styles, [name]: own } };
}

const same = (one: Numbers, other: Numbers): boolean =>
  Object.entries(one).every(([name, value]) => Math.abs(value - (other[name] ?? value)) < 1e-9);

/** To six digits after the point, which no picture shows. */
const rounded = (entries: [string, number][]): Record<string, number> =>
  Object.fromEntries(entries.map(([name, value]) => [name, Math.round(value * 1e6) / 1e6]));

/** The design without those mixtures of styles that no key names. */
export function withoutUnusedMixes(design: Design): Design {
  const used = new Set(design.keys?.map(({ style }) => style));
  const { styles = {} } = design;
  const kept = Object.entries(styles).filter(([name]) => used.has(name) || !/^mix(-\d+)?$/.test(name));
  return kept.length === Object.keys(styles).length ? design : { ...design, styles: Object.fromEntries(kept) };
}

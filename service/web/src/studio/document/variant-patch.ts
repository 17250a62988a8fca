/** Variants as merge patches (RFC 7396) on the present state of their layer. */

import type { Params } from "../../api/schemas";
import type { Layer, Variant } from "./document";

/** Parameters of a variant; null in its patch means a parameter with its default. */
export const paramsOf = ({ set }: Variant): Params =>
  Object.fromEntries(Object.entries(set.params ?? {}).filter(([, value]) => value !== null));

/** The patch that gives the layer exactly the variant's parameters: those that the layer has besides are removed. */
export function completedSet(variant: Variant, layer: Layer): Variant["set"] {
  const removed = Object.keys(layer.params ?? {}).map((name): [string, unknown] => [name, null]);
  return { ...variant.set, params: { ...Object.fromEntries(removed), ...paramsOf(variant) } };
}

/** Cards of a preview: one for each variant. */
export const cardsOf = (variants: readonly Variant[], layer: Layer): { id: string; set: Variant["set"] }[] =>
  variants.map((variant) => ({ id: variant.id, set: completedSet(variant, layer) }));

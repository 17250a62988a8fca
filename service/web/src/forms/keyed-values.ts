/** Numbers over time, as the service has them: [[frame, value], ...], linear between keys. Pure functions. */

import type { Params } from "../api/schemas";
import type { Key } from "../ui/value-curve";

/** The keys of a value; undefined: it is no list of keys. */
export const keysOf = (value: unknown): readonly Key[] | undefined =>
  Array.isArray(value) && Array.isArray(value[0]) ? value : undefined;

export function valueAt(keys: readonly Key[], frame: number): number {
  const before = keys.findLast(([at]) => at <= frame);
  const after = keys.find(([at]) => at > frame);
  if (!before || !after) return (before ?? after)?.[1] ?? 0;
  return before[1] + ((frame - before[0]) / (after[0] - before[0])) * (after[1] - before[1]);
}

/** The keys with one more, or with another value for one. */
export const withKey = (keys: readonly Key[], frame: number, value: number): readonly Key[] =>
  [...keys.filter(([at]) => at !== frame), [frame, value] as const].sort((a, b) => a[0] - b[0]);

/** The value without the key of a frame: without any, it is the number that this key had. */
export function withoutKey(keys: readonly Key[], frame: number): readonly Key[] | number {
  const rest = keys.filter(([at]) => at !== frame);
  return rest.length ? rest : valueAt(keys, frame);
}

/** Parameters as they are at a frame. */
export function paramsAt(params: Params, frame: number): Params {
  const now = (value: unknown) => {
    const keys = keysOf(value);
    return keys ? valueAt(keys, frame) : value;
  };
  return Object.fromEntries(Object.entries(params).map(([name, value]) => [name, now(value)]));
}

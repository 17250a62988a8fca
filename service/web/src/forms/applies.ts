/** Whether a parameter or an input has an effect with the others: the conditions are data of the method. */

import type { Params, When } from "../api/schemas";
import { keysOf } from "./keyed-values";

/** What is known besides the parameters; conditions on what is unknown count as met. */
export interface Situation {
  /** Names of the given inputs. */
  inputs?: readonly string[];
  /** Whether frames are painted as they arrive. */
  stream?: boolean;
  /** Whether a piece of a film is painted. */
  piece?: boolean;
  /** Kinds of render passes that the video has. */
  passes?: readonly string[];
}

/** `when`: alternatives, of which one must hold; none: always. `params`: every value, defaults included. */
export function applies(when: readonly When[] | undefined, params: Params, situation: Situation): boolean {
  return !when?.length || when.some((one) => holds(one, params, situation));
}

/** The largest value of a number in the film. */
const largest = (value: unknown): number =>
  Math.max(...(keysOf(value)?.map(([, number]) => number) ?? [Number(value ?? 0)]));

function holds(when: When, params: Params, { inputs, stream, piece, passes }: Situation): boolean {
  const {
    params: values = {},
    above = {},
    inputs: needed = [],
    without = [],
    without_passes: absent = [],
    way = "",
  } = when;
  return (
    Object.entries(values).every(([name, allowed]) => allowed.includes(String(params[name]))) &&
    Object.entries(above).every(([name, limit]) => largest(params[name]) > limit) &&
    (!inputs || !needed.length || needed.some((name) => inputs.includes(name))) &&
    (!inputs || !without.some((name) => inputs.includes(name))) &&
    !absent.some((kind) => passes?.includes(kind)) &&
    !(way && stream) &&
    !(way === "piece" && piece === false)
  );
}

/** Colour schemes: the hues, saturation and brightness of pictures, as the service measures them (docs/abstraction.md). */

import { hsvOf } from "../ui/palette";

/** Hues of 10 degrees each, the first of which is red. */
export const HUES = 36;
/** Saturation or value up to which a pixel's hue means nothing, and value up to which its saturation does not. */
const MEANINGLESS = 0.125;

export interface ColourScheme {
  /** A weight for each hue, at least one above 0. */
  hue: number[];
  saturation_mean: number;
  saturation_std: number;
  value_mean: number;
}

/** The scheme of pictures together: RGBA, 8 bit; null if none of their pixels has a hue. */
export function schemeOf(pictures: Iterable<Uint8ClampedArray>): ColourScheme | null {
  const hue: number[] = Array(HUES).fill(0);
  let [pixels, lit, value, saturation, squares] = [0, 0, 0, 0, 0];
  for (const data of pictures) {
    for (let i = 0; i < data.length; i += 4) {
      const hsv = hsvOf([data[i] ?? 0, data[i + 1] ?? 0, data[i + 2] ?? 0]);
      pixels += 1;
      value += hsv.value;
      if (hsv.value <= MEANINGLESS) continue;
      lit += 1;
      saturation += hsv.saturation;
      squares += hsv.saturation ** 2;
      const bin = Math.round((hsv.hue * HUES) / 360) % HUES;
      if (hsv.saturation > MEANINGLESS) hue[bin] = (hue[bin] ?? 0) + 1;
    }
  }
  const most = Math.max(...hue);
  if (!most) return null;
  const mean = saturation / lit;
  return {
    hue: hue.map((count) => rounded(count / most)),
    saturation_mean: rounded(mean),
    saturation_std: rounded(Math.sqrt(Math.max(0, squares / lit - mean ** 2))),
    value_mean: rounded(value / pixels),
  };
}

/** The weights after a stroke from one point of the histogram to another: [position, weight], both 0..1. */
export function drawn(
  hue: readonly number[],
  from: readonly [number, number],
  to: readonly [number, number],
): number[] {
  const [first, last] = [from, to].map(([x]) => Math.min(HUES - 1, Math.max(0, Math.floor(x * HUES)))) as [
    number,
    number,
  ];
  const next = [...hue];
  for (let bin = Math.min(first, last); bin <= Math.max(first, last); bin++) {
    const share = first === last ? 1 : (bin - first) / (last - first);
    next[bin] = rounded(Math.min(1, Math.max(0, from[1] + share * (to[1] - from[1]))));
  }
  return next.some((weight) => weight > 0) ? next : [...hue];
}

export const rounded = (value: number): number => Math.round(value * 1000) / 1000;

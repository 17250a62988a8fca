/** Curves from the pressure or the tilt of a pen to a share of a brush's size, opacity or flow. */

import type { Curve } from "../document/tip";
import { clamp } from "./geometry";

/** Value of a curve at 0..1: monotone cubic pieces (Fritsch and Carlson 1980), here of two intervals of a half. */
export function valueAt([start, middle, end]: Curve, at: number): number {
  const x = clamp(at, 0, 1) * 2;
  const [before, after] = [middle - start, end - middle];
  const slope = before * after > 0 ? (2 * before * after) / (before + after) : 0;
  return x < 1
    ? piece(start, middle, endSlope(before, slope), slope, x)
    : piece(middle, end, slope, endSlope(after, slope), x - 1);
}

/** Slope at an outer point: no more than three times the rise, so that the piece stays monotone. */
function endSlope(rise: number, inner: number): number {
  const slope = (3 * rise - inner) / 2;
  return slope * rise <= 0 ? 0 : Math.sign(rise) * Math.min(Math.abs(slope), 3 * Math.abs(rise));
}

/** Cubic Hermite piece over an interval of length 1. */
function piece(a: number, b: number, slopeA: number, slopeB: number, t: number): number {
  const back = 1 - t;
  return a * (1 + 2 * t) * back * back + b * t * t * (3 - 2 * t) + slopeA * t * back * back - slopeB * t * t * back;
}

/** In one sentence: why the service works at its present size. */

import type { SizeReason } from "./types";

/** `scale`: of both sides, 0..1. */
export function sizeSentence(
  scale: number,
  { reason, latency_ms: latency, deadline_ms: deadline }: SizeReason,
): string {
  const percent = `${Math.round(100 * scale)} %`;
  if (scale >= 1) return "Painted at the full size of your frames.";
  if (latency === undefined || deadline === undefined)
    return `Painted at ${percent} of the size, as before your frames changed size.`;
  const [took, allowed] = [`${Math.round(latency)} ms`, `${Math.round(deadline)} ms`];
  if (reason === "slow")
    return `Painted at ${percent} of the size: larger frames took up to ${took}, and ${allowed} are allowed.`;
  return `Painted at ${percent} of the size: smaller frames took at most ${took} of ${allowed}, so there is time for this size.`;
}

/** Below so many pixels of the shorter side, strokes and regions are coarse. */
const SMALL_PX = 200;

/** A warning while the service has reduced its size so far that the painting is coarse; empty: it has not. */
export function smallWarning({ width, height, scale }: { width: number; height: number; scale: number }): string {
  if (scale >= 1 || Math.min(width, height) >= SMALL_PX) return "";
  return `The service paints only ${width} × ${height} px, so that strokes and regions are coarse: it is too slow for more. Choose a lower rate, another method, or a faster machine.`;
}

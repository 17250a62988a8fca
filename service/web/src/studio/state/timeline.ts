/** Frames, times and steps of the timeline. */

import type { Ease } from "../document/design";

/** Time code of a frame at a nominal rate: "00:01:05:12" (hours, minutes, seconds, frames). */
export function timeCode(frame: number, fps: number): string {
  const rate = Math.max(1, Math.round(fps));
  const seconds = Math.floor(frame / rate);
  const parts = [Math.floor(seconds / 3600), Math.floor(seconds / 60) % 60, seconds % 60, frame % rate];
  return parts.map((part) => String(part).padStart(2, "0")).join(":");
}

/** The middle of a frame in seconds, where a seek is safe from rounding. */
export const seekTime = (frame: number, fps: number): number => (frame + 0.5) / fps;

/** Frames [first, end) of a clip: of a shot, or those that the filmstrip shows. */
export type Span = readonly [first: number, end: number];

export const clampFrame = (frame: number, [first, end]: Span): number =>
  Math.max(first, Math.min(Math.round(frame), end - 1));

/** The filmstrip shows at least as many frames. */
const LEAST_SPAN = 12;

const lengthOf = ([first, end]: Span): number => Math.max(1, end - first);

/** The frame under a position of a strip of `width` px; positions beyond its edges give frames beyond it. */
export const frameAt = (x: number, width: number, span: Span): number =>
  span[0] + Math.floor((x / Math.max(1, width)) * lengthOf(span));

/** Left edge of a frame on that strip, as a fraction of its width; outside 0..1 it is not shown. */
export const shareOf = (frame: number, span: Span): number => (frame - span[0]) / lengthOf(span);

export const isShown = (frame: number, [first, end]: Span): boolean => first <= frame && frame < end;

/** Frames of evenly spaced thumbnails: the middle frame of each piece. */
export function thumbnailFrames(count: number, span: Span): number[] {
  const length = lengthOf(span);
  const n = Math.max(1, Math.min(count, length));
  return Array.from({ length: n }, (_, i) => span[0] + Math.floor(((i + 0.5) * length) / n));
}

const spanFrom = (first: number, length: number, reach: Span): Span => {
  const start = Math.max(reach[0], Math.min(Math.round(first), reach[1] - length));
  return [start, Math.min(reach[1], start + length)];
};

/** `factor` times as many frames, the frame `about` in its place, within `reach`. */
export function zoomSpan(span: Span, reach: Span, factor: number, about: number): Span {
  const most = lengthOf(reach);
  const length = Math.round(Math.min(Math.max(lengthOf(span) * factor, Math.min(most, LEAST_SPAN)), most));
  const middle = about + 0.5;
  return spanFrom(middle - (middle - span[0]) * (length / lengthOf(span)), length, reach);
}

export const shiftSpan = (span: Span, reach: Span, by: number): Span => spanFrom(span[0] + by, lengthOf(span), reach);

/** The span moved as little as possible, so that it shows a frame. */
export function spanWith(span: Span, reach: Span, frame: number): Span {
  if (isShown(frame, span)) return span;
  return spanFrom(frame < span[0] ? frame : frame - lengthOf(span) + 1, lengthOf(span), reach);
}

export const nextKey = (keys: readonly number[], frame: number): number | undefined => keys.find((key) => key > frame);
export const previousKey = (keys: readonly number[], frame: number): number | undefined =>
  keys.findLast((key) => key < frame);

/** Number of the piece between two cuts that has a frame, from 1. */
export const pieceAt = (cuts: readonly number[], frame: number): number =>
  1 + cuts.filter((cut) => cut <= frame).length;

/** Share of the next key at a position 0..1 between two keys, by the easing of the first: as the film has it. */
export function eased(ease: Ease, t: number): number {
  if (ease === "hold") return t < 1 ? 0 : 1;
  if (ease === "in") return t ** 3;
  if (ease === "out") return 1 - (1 - t) ** 3;
  return ease === "smooth" ? t * t * (3 - 2 * t) : t;
}

/** Playback speed of the J, K, L keys: each press in a direction doubles the speed up to 8; K stops. */
export function shuttle(speed: number, key: "j" | "k" | "l"): number {
  if (key === "k") return 0;
  const direction = key === "l" ? 1 : -1;
  if (Math.sign(speed) !== direction) return direction;
  return direction * Math.min(8, Math.abs(speed) * 2);
}

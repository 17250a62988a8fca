/** Frames, times and steps of the timeline. */

import type { Ease, StyleKey } from "../document/design";
import { keyAt } from "../document/document";

/** Time code of a frame at a nominal rate: "00:01:05:12" (hours, minutes, seconds, frames). */
export function timeCode(frame: number, fps: number): string {
  const rate = Math.max(1, Math.round(fps));
  const seconds = Math.floor(frame / rate);
  const parts = [Math.floor(seconds / 3600), Math.floor(seconds / 60) % 60, seconds % 60, frame % rate];
  return parts.map((part) => String(part).padStart(2, "0")).join(":");
}

/** The middle of a frame in seconds, where a seek is safe from rounding. */
export const seekTime = (frame: number, fps: number): number => (frame + 0.5) / fps;

export const clampFrame = (frame: number, frames: number): number =>
  Math.min(Math.max(0, Math.round(frame)), Math.max(0, frames - 1));

/** Frames that the filmstrip shows; `end` is the first one beyond them. */
export type Span = readonly [first: number, end: number];
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

const spanFrom = (first: number, length: number, frames: number): Span => {
  const start = Math.min(Math.max(0, Math.round(first)), Math.max(0, frames - length));
  return [start, Math.min(frames, start + length)];
};

/** `factor` times as many frames, the frame `about` in its place. */
export function zoomSpan(span: Span, frames: number, factor: number, about: number): Span {
  const length = Math.round(Math.min(Math.max(lengthOf(span) * factor, Math.min(frames, LEAST_SPAN)), frames));
  const middle = about + 0.5;
  return spanFrom(middle - (middle - span[0]) * (length / lengthOf(span)), length, frames);
}

export const shiftSpan = (span: Span, frames: number, by: number): Span =>
  spanFrom(span[0] + by, lengthOf(span), frames);

/** The span moved as little as possible, so that it shows a frame. */
export function spanWith(span: Span, frames: number, frame: number): Span {
  if (isShown(frame, span)) return span;
  return spanFrom(frame < span[0] ? frame : frame - lengthOf(span) + 1, lengthOf(span), frames);
}

export const nextKey = (keys: readonly number[], frame: number): number | undefined => keys.find((key) => key > frame);
export const previousKey = (keys: readonly number[], frame: number): number | undefined =>
  keys.findLast((key) => key < frame);

/** First frames of all shots. */
export const shotStarts = (cuts: readonly number[]): number[] => [0, ...cuts];

/** Number of the shot that has a frame, from 1. */
export const shotAt = (cuts: readonly number[], frame: number): number => 1 + cuts.filter((cut) => cut <= frame).length;

/** Share of the next key at a position 0..1 between two keys, by the easing of the first: as the film has it. */
export function eased(ease: Ease, t: number): number {
  if (ease === "hold") return t < 1 ? 0 : 1;
  if (ease === "in") return t ** 3;
  if (ease === "out") return 1 - (1 - t) ** 3;
  return ease === "smooth" ? t * t * (3 - 2 * t) : t;
}

interface ValueKey {
  frame: number;
  value: number;
  ease: Ease;
}

/** The value of a parameter at a frame: constant before the first and after the last key. Hues, in degrees, change the
 * shorter way round. */
export function valueAt(keys: readonly ValueKey[], frame: number, name = ""): number | undefined {
  const before = keys.findLast((key) => key.frame <= frame);
  const after = keys.find((key) => key.frame > frame);
  if (!before || !after) return (before ?? after)?.value;
  const t = (frame - before.frame) / (after.frame - before.frame);
  const difference = after.value - before.value;
  const shorter = name === "hue" && Math.abs(difference) > 180 ? difference - 360 * Math.sign(difference) : difference;
  return before.value + shorter * eased(before.ease, t);
}

/** The style at a frame, from the keys of one region: between two keys, the numbers that both set are interpolated. */
export function styleAt(track: readonly StyleKey[], frame: number): StyleKey | undefined {
  const key = keyAt(track, frame);
  const after = track.find((other) => other.frame > frame);
  if (!key?.set || !after?.set || key.frame >= frame) return key;
  const ends = [key, after];
  const set = Object.fromEntries(
    Object.entries(key.set).map(([name, value]) => {
      if (ends.some((end) => typeof end.set?.[name] !== "number")) return [name, value];
      const keys = ends.map((end) => ({
        frame: end.frame,
        value: Number(end.set?.[name]),
        ease: end.ease ?? "linear",
      }));
      const found = valueAt(keys, frame, name) ?? Number(value);
      return [name, name === "hue" ? found - 360 * Math.round(found / 360) : found];
    }),
  );
  return { ...key, set };
}

/** Playback speed of the J, K, L keys: each press in a direction doubles the speed up to 8; K stops. */
export function shuttle(speed: number, key: "j" | "k" | "l"): number {
  if (key === "k") return 0;
  const direction = key === "l" ? 1 : -1;
  if (Math.sign(speed) !== direction) return direction;
  return direction * Math.min(8, Math.abs(speed) * 2);
}

/** Frames, times and steps of the timeline. */

import type { Ease } from "./document";

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

/** The frame under a position of a strip that shows all frames over `width` px. */
export const frameAt = (x: number, width: number, frames: number): number =>
  clampFrame(Math.floor((x / Math.max(1, width)) * frames), frames);

/** Left edge of a frame on that strip, as a fraction of its width. */
export const shareOf = (frame: number, frames: number): number => frame / Math.max(1, frames);

/** Frames of evenly spaced thumbnails: the middle frame of each piece. */
export function thumbnailFrames(count: number, frames: number): number[] {
  const n = Math.max(1, Math.min(count, frames));
  return Array.from({ length: n }, (_, i) => clampFrame(Math.floor(((i + 0.5) * frames) / n), frames));
}

export const nextKey = (keys: readonly number[], frame: number): number | undefined => keys.find((key) => key > frame);
export const previousKey = (keys: readonly number[], frame: number): number | undefined =>
  keys.findLast((key) => key < frame);

/** Share of the next key at a position 0..1 between two keys, by the easing of the first. */
export function eased(ease: Ease, t: number): number {
  if (ease === "hold") return t < 1 ? 0 : 1;
  if (ease === "in") return t * t;
  if (ease === "out") return t * (2 - t);
  return ease === "smooth" ? t * t * (3 - 2 * t) : t;
}

interface ValueKey {
  frame: number;
  value: number;
  ease: Ease;
}

/** The value of a curve at a frame: constant before the first and after the last key. */
export function valueAt(keys: readonly ValueKey[], frame: number): number | undefined {
  const before = keys.findLast((key) => key.frame <= frame);
  const after = keys.find((key) => key.frame > frame);
  if (!before || !after) return (before ?? after)?.value;
  const t = (frame - before.frame) / (after.frame - before.frame);
  return before.value + (after.value - before.value) * eased(before.ease, t);
}

/** Playback speed of the J, K, L keys: each press in a direction doubles the speed up to 8; K stops. */
export function shuttle(speed: number, key: "j" | "k" | "l"): number {
  if (key === "k") return 0;
  const direction = key === "l" ? 1 : -1;
  if (Math.sign(speed) !== direction) return direction;
  return direction * Math.min(8, Math.abs(speed) * 2);
}

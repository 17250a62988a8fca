/** Rectangles of whole pixels. */

import type { Size } from "./geometry";

export interface Rect {
  x: number;
  y: number;
  width: number;
  height: number;
}

/** The smallest rectangle that contains both; null: nothing. */
export function unionOf(a: Rect | null, b: Rect): Rect;
export function unionOf(a: Rect | null, b: Rect | null): Rect | null;
export function unionOf(a: Rect | null, b: Rect | null): Rect | null {
  if (!a || !b) return a ?? b;
  const [x, y] = [Math.min(a.x, b.x), Math.min(a.y, b.y)];
  const right = Math.max(a.x + a.width, b.x + b.width);
  const bottom = Math.max(a.y + a.height, b.y + b.height);
  return { x, y, width: right - x, height: bottom - y };
}

/** The part within a picture of this size; null: there is none. */
export function clipped({ x, y, width, height }: Rect, size: Size): Rect | null {
  const [left, top] = [Math.max(0, x), Math.max(0, y)];
  const [right, bottom] = [Math.min(size.width, x + width), Math.min(size.height, y + height)];
  return left < right && top < bottom ? { x: left, y: top, width: right - left, height: bottom - top } : null;
}

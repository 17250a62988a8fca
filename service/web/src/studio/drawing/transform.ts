/** Selections of pixels, and moving, scaling and turning them. Coordinates are pixels of the video. */

import type { Point } from "../document/document";
import { type Context, createCanvas } from "./canvas";
import type { Size } from "./geometry";
import { rowsOf, runsOf, type TransformStroke } from "./strokes";

/** An affine map: x' = a x + c y + e, y' = b x + d y + f. */
export type Matrix = readonly [a: number, b: number, c: number, d: number, e: number, f: number];

export const IDENTITY: Matrix = [1, 0, 0, 1, 0, 0];

export interface Box {
  x: number;
  y: number;
  width: number;
  height: number;
}

/** The map that does `first`, then `second`. */
export function after(second: Matrix, first: Matrix): Matrix {
  const [a, b, c, d, e, f] = second;
  const [g, h, i, j, k, l] = first;
  return [a * g + c * h, b * g + d * h, a * i + c * j, b * i + d * j, a * k + c * l + e, b * k + d * l + f];
}

export const mapped = ([a, b, c, d, e, f]: Matrix, [x, y]: Point): Point => [a * x + c * y + e, b * x + d * y + f];

/** The map that undoes another one, which must not be flat. */
export function inverse([a, b, c, d, e, f]: Matrix): Matrix {
  const det = a * d - b * c;
  return [d / det, -b / det, -c / det, a / det, (c * f - d * e) / det, (b * e - a * f) / det];
}

export const moved = (dx: number, dy: number): Matrix => [1, 0, 0, 1, dx, dy];

export const scaledAbout = ([x, y]: Point, across: number, down: number): Matrix => [
  across,
  0,
  0,
  down,
  x - across * x,
  y - down * y,
];

export function turnedAbout([x, y]: Point, radians: number): Matrix {
  const [cos, sin] = [Math.cos(radians), Math.sin(radians)];
  return [cos, sin, -sin, cos, x - cos * x + sin * y, y - sin * x - cos * y];
}

/** Whether pixels move by whole pixels, so that none is mixed with its neighbours. */
export const isShift = ([a, b, c, d, e, f]: Matrix): boolean =>
  a === 1 && b === 0 && c === 0 && d === 1 && Number.isInteger(e) && Number.isInteger(f);

/** Numbers that are short as JSON, and exact to a hundredth of a pixel across 10,000 of them. */
export const roundedMatrix = (matrix: Matrix): Matrix =>
  matrix.map((value, i) =>
    i < 4 ? Math.round(value * 1e6) / 1e6 : Math.round(value * 100) / 100,
  ) as unknown as Matrix;

// -- selections: runs of pixels, as in fills

/** The pixels whose centres are in a polygon (even-odd rule). */
export function runsInside(polygon: readonly Point[], { width, height }: Size): number[] {
  const mask = new Uint8Array(width * height);
  for (let y = 0; y < height; y++) {
    const crossings: number[] = [];
    for (let i = 0, j = polygon.length - 1; i < polygon.length; j = i++) {
      const [[ax, ay], [bx, by]] = [polygon[i] ?? [0, 0], polygon[j] ?? [0, 0]];
      if (ay > y + 0.5 !== by > y + 0.5) crossings.push(ax + ((y + 0.5 - ay) / (by - ay)) * (bx - ax));
    }
    crossings.sort((a, b) => a - b);
    for (let i = 0; i + 1 < crossings.length; i += 2) {
      const from = Math.max(0, Math.ceil((crossings[i] ?? 0) - 0.5));
      const until = Math.min(width, Math.ceil((crossings[i + 1] ?? 0) - 0.5));
      if (until > from) mask.fill(1, y * width + from, y * width + until);
    }
  }
  return runsOf(mask);
}

/** The pixels of a rectangle between two corners. */
export const runsOfRectangle = ([ax, ay]: Point, [bx, by]: Point, size: Size): number[] => {
  const [left, right] = [Math.round(Math.min(ax, bx)), Math.round(Math.max(ax, bx))];
  const [top, bottom] = [Math.round(Math.min(ay, by)), Math.round(Math.max(ay, by))];
  const corners: Point[] = [
    [left, top],
    [right, top],
    [right, bottom],
    [left, bottom],
  ];
  return runsInside(corners, size);
};

/** The smallest box around runs of pixels; null: there are none. */
export function boxOfRuns(runs: readonly number[], { width }: Size): Box | null {
  let [left, top, right, bottom] = [Number.POSITIVE_INFINITY, Number.POSITIVE_INFINITY, -1, -1];
  for (const [x, y, length] of rowsOf(runs, width)) {
    left = Math.min(left, x);
    right = Math.max(right, x + length);
    top = Math.min(top, y);
    bottom = Math.max(bottom, y + 1);
  }
  return right < 0 ? null : { x: left, y: top, width: right - left, height: bottom - top };
}

/** The smallest box around the pixels of a canvas that are not transparent; null: all are. */
export function boxOfPaint(context: Context): Box | null {
  const { width, height } = context.canvas;
  const { data } = context.getImageData(0, 0, width, height);
  const mask = new Uint8Array(width * height);
  for (let i = 0; i < mask.length; i++) mask[i] = data[4 * i + 3] ? 1 : 0;
  return boxOfRuns(runsOf(mask), { width, height });
}

function pathOf(runs: readonly number[], { width }: Size): Path2D {
  const path = new Path2D();
  for (const [x, y, length] of rowsOf(runs, width)) path.rect(x, y, length, 1);
  return path;
}

/** Move the layer's selected pixels, or all, along a map. */
export function drawTransform(context: Context, { matrix, runs }: TransformStroke, size: Size): void {
  const [part, own] = createCanvas(size);
  const path = runs && pathOf(runs, size);
  if (path) own.clip(path);
  own.drawImage(context.canvas, 0, 0);
  context.save();
  context.globalCompositeOperation = "destination-out";
  if (path) context.fill(path);
  else context.fillRect(0, 0, size.width, size.height);
  context.globalCompositeOperation = "source-over";
  context.setTransform(...(matrix as [number, number, number, number, number, number]));
  context.imageSmoothingEnabled = !isShift(matrix);
  context.imageSmoothingQuality = "high";
  context.drawImage(part, 0, 0);
  context.restore();
}

/** Plane geometry of the stage: the view (zoom and pan), polygons, brush samples, direction elements. */

import type { DirectionElement, Pattern } from "../document/design";
import type { Point } from "../document/document";

export interface Size {
  width: number;
  height: number;
}

/** A point of the picture (px) appears at (x, y) + scale * its own place, turned and mirrored, on the stage (CSS px). */
export interface View {
  scale: number;
  x: number;
  y: number;
  /** Degrees clockwise. */
  turn?: number;
  /** Whether left and right are exchanged. */
  mirrored?: boolean;
}

const DEGREE = Math.PI / 180;
const MIN_SCALE = 0.05;
const MAX_SCALE = 32;

/** The view that shows the whole picture in the middle of the stage, with a margin in CSS px; it keeps turn and mirror. */
export function fitView(
  picture: Size,
  stage: Size,
  margin = 0,
  { turn = 0, mirrored = false }: Partial<View> = {},
): View {
  const [cos, sin] = [Math.abs(Math.cos(turn * DEGREE)), Math.abs(Math.sin(turn * DEGREE))];
  const width = picture.width * cos + picture.height * sin;
  const height = picture.width * sin + picture.height * cos;
  const scale = clamp(
    Math.min((stage.width - 2 * margin) / width, (stage.height - 2 * margin) / height),
    MIN_SCALE,
    MAX_SCALE,
  );
  const view: View = { scale, x: 0, y: 0, ...(turn && { turn }), ...(mirrored && { mirrored }) };
  const [x, y] = toStage(view, [picture.width / 2, picture.height / 2]);
  return { ...view, x: stage.width / 2 - x, y: stage.height / 2 - y };
}

/** The view turned by degrees clockwise about a fixed point of the stage. */
export function turnAbout(view: View, at: Point, degrees: number): View {
  const turn = (((((view.turn ?? 0) + degrees + 180) % 360) + 360) % 360) - 180;
  return holding(view, { ...view, turn }, at);
}

/** The view with left and right exchanged about a point of the stage. */
export const mirrorAbout = (view: View, at: Point): View =>
  holding(view, { ...view, mirrored: !view.mirrored, turn: -(view.turn ?? 0) || 0 }, at);

/** `next`, moved so that the point of the picture that `view` shows at `at` stays there. */
function holding(view: View, next: View, at: Point): View {
  const [x, y] = toStage(next, toPicture(view, at));
  return { ...next, x: next.x + at[0] - x, y: next.y + at[1] - y };
}

/** Zoom by a factor about a fixed point of the stage. */
export function zoomAbout(view: View, [x, y]: Point, factor: number): View {
  const scale = clamp(view.scale * factor, MIN_SCALE, MAX_SCALE);
  const ratio = scale / view.scale;
  return { ...view, scale, x: x - (x - view.x) * ratio, y: y - (y - view.y) * ratio };
}

export const panBy = (view: View, dx: number, dy: number): View => ({ ...view, x: view.x + dx, y: view.y + dy });

/** The linear part of a view: [a, b, c, d] of a canvas's transform. */
export function matrixOf({ scale, turn = 0, mirrored = false }: View): [number, number, number, number] {
  const [cos, sin] = turn ? [scale * Math.cos(turn * DEGREE), scale * Math.sin(turn * DEGREE)] : [scale, 0];
  return mirrored ? [-cos, -sin, -sin, cos] : [cos, sin, -sin, cos];
}

export function toPicture(view: View, [x, y]: Point): Point {
  const [a, b, c, d] = matrixOf(view);
  const [dx, dy] = [x - view.x, y - view.y];
  const size = a * d - b * c;
  return [(d * dx - c * dy) / size, (a * dy - b * dx) / size];
}

export function toStage(view: View, [x, y]: Point): Point {
  const [a, b, c, d] = matrixOf(view);
  return [view.x + a * x + c * y, view.y + b * x + d * y];
}

export const clamp = (value: number, low: number, high: number): number => Math.min(high, Math.max(low, value));

export const distance = ([ax, ay]: Point, [bx, by]: Point): number => Math.hypot(bx - ax, by - ay);

/** Whether a point is inside a polygon (even-odd rule). */
export function contains(polygon: readonly Point[], [x, y]: Point): boolean {
  let inside = false;
  for (let i = 0, j = polygon.length - 1; i < polygon.length; j = i++) {
    const [xi, yi] = polygon[i] ?? [0, 0];
    const [xj, yj] = polygon[j] ?? [0, 0];
    if (yi > y !== yj > y && x < ((xj - xi) * (y - yi)) / (yj - yi) + xi) inside = !inside;
  }
  return inside;
}

/** Signed area of a polygon; positive if it runs clockwise on the screen (y down). */
export function area(polygon: readonly Point[]): number {
  let sum = 0;
  for (let i = 0; i < polygon.length; i++) {
    const [ax, ay] = polygon[i] ?? [0, 0];
    const [bx, by] = polygon[(i + 1) % polygon.length] ?? [0, 0];
    sum += ax * by - bx * ay;
  }
  return sum / 2;
}

/** A polyline with fewer points that stays within `tolerance` of the given one (Douglas and Peucker 1973). */
export function simplify(points: readonly Point[], tolerance: number): Point[] {
  const first = points[0];
  const last = points.at(-1);
  if (!first || !last || points.length < 3) return [...points];
  let farthest = 0;
  let split = 0;
  points.forEach((point, i) => {
    const away = distanceToSegment(point, first, last);
    if (away > farthest) [farthest, split] = [away, i];
  });
  if (farthest <= tolerance) return [first, last];
  const head = simplify(points.slice(0, split + 1), tolerance);
  return [...head.slice(0, -1), ...simplify(points.slice(split), tolerance)];
}

function distanceToSegment(point: Point, a: Point, b: Point): number {
  const [dx, dy] = [b[0] - a[0], b[1] - a[1]];
  const length2 = dx * dx + dy * dy;
  const along = length2 ? clamp(((point[0] - a[0]) * dx + (point[1] - a[1]) * dy) / length2, 0, 1) : 0;
  return distance(point, [a[0] + along * dx, a[1] + along * dy]);
}

/** Angle of a vector, degrees clockwise from the right in 0..360. */
export const angleOf = (from: Point, to: Point): number =>
  (Math.atan2(to[1] - from[1], to[0] - from[0]) / DEGREE + 360) % 360;

/** Half turns of the stroke direction on the way round the centre. */
const WINDINGS: Record<Pattern, number> = {
  regular: 0,
  wedge: 1,
  trisector: -1,
  node: 2,
  center: 2,
  spiral: 2,
  saddle: -2,
};
/** Angle between strokes and rays, degrees, for rotationally symmetric patterns. */
const TILTS: Partial<Record<Pattern, number>> = { node: 0, center: 90, spiral: 45 };

/** Whether the pattern is rotationally symmetric, so that its angle rotates each stroke instead. */
export const isSymmetric = (pattern: Pattern): boolean => pattern in TILTS;

/** Double angle of the strokes of one element at an offset from its centre, radians. */
function doubleAngle({ pattern, angle = 0 }: DirectionElement, dx: number, dy: number): number {
  const rotation = isSymmetric(pattern) ? 0 : angle;
  const around = WINDINGS[pattern] * (Math.atan2(dy, dx) - rotation * DEGREE);
  return around + 2 * DEGREE * (angle + (TILTS[pattern] ?? 0));
}

/** The reach of an element, heights of the picture; 0: everywhere. */
export const distanceOf = (reach: DirectionElement["reach"]): number => (typeof reach === "number" ? reach : 0);

/**
 * Direction of strokes at a point as the elements ask for it: double angles are added, each weighted by its strength and
 * exp(-distance / reach). The service computes the exact field; the page shows this one until it arrives.
 *
 * @param point fractions of width and height
 * @param aspect width / height of the picture
 * @returns angle in radians, 0..pi, y down; weight: length of the sum
 */
export function directionAt(
  elements: readonly DirectionElement[],
  [x, y]: Point,
  aspect: number,
): { angle: number; weight: number } {
  let [cos, sin] = [0, 0];
  for (const element of elements) {
    const { at, strength = 1 } = element;
    const reach = distanceOf(element.reach);
    const [dx, dy] = [(x - at[0]) * aspect, y - at[1]];
    const weight = strength * (reach > 0 ? Math.exp(-Math.hypot(dx, dy) / reach) : 1);
    const double = doubleAngle(element, dx, dy);
    cos += weight * Math.cos(double);
    sin += weight * Math.sin(double);
  }
  const angle = Math.atan2(sin, cos) / 2;
  return { angle: angle < 0 ? angle + Math.PI : angle, weight: Math.hypot(cos, sin) };
}

/** Changes to label maps, the frames that a correction solves again, and the colours of clusters. Pure functions. */

import type { LabelCorrection } from "../document/document";
import type { Size } from "../drawing/geometry";
import type { LabelMap } from "./label-png";

/** Default number of frames before and after a corrected map that are solved again. */
const REACH_FRAMES = 6;

/** A copy in which every pixel within `radius` px of the path has the label. The path is in px of the map. */
export function stamped(
  map: LabelMap,
  path: readonly [x: number, y: number][],
  radius: number,
  label: number,
): LabelMap {
  const labels = map.labels.slice();
  const first = path[0];
  if (first) disc(labels, map, first, radius, label);
  for (let i = 1; i < path.length; i++) {
    const [a, b] = [path[i - 1], path[i]];
    if (!a || !b) continue;
    const steps = Math.max(1, Math.ceil(Math.hypot(b[0] - a[0], b[1] - a[1]) / Math.max(1, radius / 2)));
    for (let k = 1; k <= steps; k++) {
      const t = k / steps;
      disc(labels, map, [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])], radius, label);
    }
  }
  return { ...map, labels };
}

function disc(
  labels: Uint16Array,
  { width, height }: LabelMap,
  [cx, cy]: [number, number],
  radius: number,
  label: number,
): void {
  for (let y = Math.max(0, Math.floor(cy - radius)); y <= Math.min(height - 1, Math.ceil(cy + radius)); y++)
    for (let x = Math.max(0, Math.floor(cx - radius)); x <= Math.min(width - 1, Math.ceil(cx + radius)); x++)
      if ((x + 0.5 - cx) ** 2 + (y + 0.5 - cy) ** 2 <= radius * radius) labels[y * width + x] = label;
}

/**
 * A map of a smaller size at that of the video, which corrections have. Taking the nearest pixels back down gives the same map.
 */
export function enlarged(map: LabelMap, { width, height }: Size): LabelMap {
  if (map.width === width && map.height === height) return map;
  const sourceOf = (at: number, length: number, source: number) => Math.ceil(((at + 1) * source) / length) - 1;
  const labels = new Uint16Array(width * height);
  for (let y = 0; y < height; y++) {
    const row = map.width * sourceOf(y, height, map.height);
    for (let x = 0; x < width; x++) labels[y * width + x] = map.labels[row + sourceOf(x, width, map.width)] ?? 0;
  }
  return { width, height, labels };
}

/** A copy in which pixels of one label have another. */
export function joined(map: LabelMap, from: number, to: number): LabelMap {
  return { ...map, labels: map.labels.map((label) => (label === from ? to : label)) };
}

/** The labels of a map with their share of its area, the largest first; 0 is left out. */
export function areas({ labels }: LabelMap): [label: number, share: number][] {
  const counts = new Map<number, number>();
  for (const label of labels) if (label) counts.set(label, (counts.get(label) ?? 0) + 1);
  return [...counts].map(([label, n]): [number, number] => [label, n / labels.length]).sort((a, b) => b[1] - a[1]);
}

/** The frames that a correction at `frame` solves again: [first, end), within the video. */
export function solvedAround(frame: number, frames: number): [number, number] {
  return [Math.max(0, frame - REACH_FRAMES), Math.min(frames, frame + REACH_FRAMES + 1)];
}

/** How many frames the corrections solve again; a correction without an interval: all of them. */
export function solvedFrames(corrections: readonly LabelCorrection[], frames: number): number {
  const solved = new Set<number>();
  for (const { solve } of corrections) {
    const [from, until] = solve ?? [0, frames];
    for (let frame = from; frame < until; frame++) solved.add(frame);
  }
  return solved.size;
}

/** Red, green and blue, 0..255, of a cluster, as in the artefact `overlay`; gray without a cluster. */
export function colourOf(label: number): [number, number, number] {
  if (!label) return [128, 128, 128];
  const hue = ((label * 111.25) % 180) / 30;
  const channel = (n: number): number => {
    const k = (n + hue) % 6;
    return Math.round(255 * (1 - 0.78 * Math.max(0, Math.min(k, 4 - k, 1))));
  };
  return [channel(5), channel(3), channel(1)];
}

export const titleOf = (label: number): string =>
  label === 0 ? "No cluster" : label === 1 ? "Background" : `Object ${label}`;

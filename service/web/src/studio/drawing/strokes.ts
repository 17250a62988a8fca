/** Painted layers as data: strokes with pressure, smudges, and the fill of an area. Coordinates are pixels of the video. */

import { clamp, distance, type Size } from "./geometry";

/** One sample of the pen: position in px, pressure 0..1. */
export type Sample = [x: number, y: number, pressure: number];

export interface BrushStroke {
  kind: "brush" | "eraser";
  /** "#rrggbb" */
  color: string;
  /** Width at full pressure, px. */
  size: number;
  /** 0..1 */
  opacity: number;
  samples: readonly Sample[];
}

export interface FillStroke {
  kind: "fill";
  color: string;
  opacity: number;
  /** Start index and length of each run of filled pixels; one may cover several rows. */
  runs: readonly number[];
}

/** Moves the layer's own paint along the stroke. */
export interface SmudgeStroke {
  kind: "smudge";
  /** Width at full pressure, px. */
  size: number;
  /** How far the paint is carried, 0..1. */
  opacity: number;
  samples: readonly Sample[];
}

export type DrawnStroke = BrushStroke | SmudgeStroke;
export type Stroke = DrawnStroke | FillStroke;

export interface PictureLayer {
  id: string;
  name: string;
  opacity: number;
  visible: boolean;
  /** Asset id of a picture below the strokes. */
  base: string | null;
  strokes: readonly Stroke[];
}

/** A painted key in its editable form; layers from back to front. */
export interface KeyPicture {
  layers: readonly PictureLayer[];
}

const MIN_PRESSURE = 0.05;

/** Width of a stroke at a pressure: a fifth of the size at none, the whole size at full pressure. */
export const widthAt = (size: number, pressure: number): number =>
  size * (0.2 + 0.8 * clamp(pressure, MIN_PRESSURE, 1));

/** Whether two samples are less than `least` px apart. */
export const isNear = (a: Sample, b: Sample, least: number): boolean => distance([a[0], a[1]], [b[0], b[1]]) < least;

/** Numbers with one decimal for positions and two for pressure: enough for pixels, and short as JSON. */
export const rounded = ([x, y, pressure]: Sample): Sample => [
  Math.round(x * 10) / 10,
  Math.round(y * 10) / 10,
  Math.round(pressure * 100) / 100,
];

export const changePictureLayer = (
  picture: KeyPicture,
  id: string,
  change: (layer: PictureLayer) => PictureLayer,
): KeyPicture => ({ layers: picture.layers.map((layer) => (layer.id === id ? change(layer) : layer)) });

export const addStroke = (picture: KeyPicture, id: string, stroke: Stroke): KeyPicture =>
  changePictureLayer(picture, id, (layer) => ({ ...layer, strokes: [...layer.strokes, stroke] }));

/**
 * Runs of the connected area around a pixel whose colours differ by at most `tolerance` in each channel.
 *
 * @param pixels RGBA, 8 bit, row by row
 */
export function floodRuns(
  pixels: Uint8ClampedArray,
  { width, height }: Size,
  start: readonly [number, number],
  tolerance: number,
): number[] {
  const [startX, startY] = [Math.floor(start[0]), Math.floor(start[1])];
  if (startX < 0 || startY < 0 || startX >= width || startY >= height) return [];
  const filled = new Uint8Array(width * height);
  const seed = 4 * (startY * width + startX);
  const target = [0, 1, 2, 3].map((channel) => pixels[seed + channel] ?? 0);
  const fits = (index: number) =>
    !filled[index] &&
    target.every((value, channel) => Math.abs((pixels[4 * index + channel] ?? 0) - value) <= tolerance);
  const waiting = [startY * width + startX];
  while (waiting.length) {
    const index = waiting.pop() ?? 0;
    if (!fits(index)) continue;
    const row = index - (index % width);
    let left = index;
    while (left > row && fits(left - 1)) left -= 1;
    let right = index;
    while (right < row + width - 1 && fits(right + 1)) right += 1;
    for (let at = left; at <= right; at++) {
      filled[at] = 1;
      if (row > 0) waiting.push(at - width);
      if (row + width < width * height) waiting.push(at + width);
    }
  }
  return runsOf(filled);
}

/** The pieces of runs that lie in one row each: left, top, length. A run continues in the next row. */
export function rowsOf(runs: readonly number[], width: number): [x: number, y: number, length: number][] {
  const pieces: [number, number, number][] = [];
  for (let i = 0; i < runs.length; i += 2) {
    let start = runs[i] ?? 0;
    const end = start + (runs[i + 1] ?? 0);
    while (start < end) {
      const x = start % width;
      const length = Math.min(end - start, width - x);
      pieces.push([x, (start - x) / width, length]);
      start += length;
    }
  }
  return pieces;
}

/** Start and length of each run of non-zero values. */
export function runsOf(mask: Uint8Array): number[] {
  const runs: number[] = [];
  for (let i = 0; i < mask.length; i++) {
    if (!mask[i]) continue;
    const start = i;
    while (i < mask.length && mask[i]) i += 1;
    runs.push(start, i - start);
  }
  return runs;
}

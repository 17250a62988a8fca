/** Painted layers as data: strokes with pressure, smudges, and the fill of an area. Coordinates are pixels of the video. */

import type { Tip } from "../document/tip";
import type { PaintBlend } from "./blend";
import { clamp, distance } from "./geometry";
import type { Matrix } from "./transform";

/** One sample of the pen: position in px, pressure 0..1; tilt from upright and direction of the lean, degrees, if it leans. */
export type Sample = [x: number, y: number, pressure: number, tilt?: number, lean?: number];

/** What a stroke of stamps has; a stroke without a tip is a plain round line, whose width follows the pressure. */
interface Stamped {
  tip?: Tip;
  /** What is random in the stroke follows from it. */
  seed?: number;
}

export interface BrushStroke extends Stamped {
  kind: "brush" | "eraser";
  /** "#rrggbb" */
  color: string;
  /** Width at full pressure, px. */
  size: number;
  /** 0..1 */
  opacity: number;
  samples: readonly Sample[];
  /** Whether the layer's opacity stays as it is. */
  locked?: boolean;
}

export interface FillStroke {
  kind: "fill";
  color: string;
  opacity: number;
  locked?: boolean;
  /** Whether it takes the layer's paint away instead. */
  erase?: boolean;
  /** Start index and length of each run of filled pixels; one may cover several rows. */
  runs: readonly number[];
}

/** Moves the layer's own paint along the stroke. */
export interface SmudgeStroke extends Stamped {
  kind: "smudge";
  /** Width at full pressure, px. */
  size: number;
  /** How far the paint is carried, 0..1. */
  opacity: number;
  samples: readonly Sample[];
  locked?: boolean;
}

/** Moves, scales and turns the layer's selected pixels. */
export interface TransformStroke {
  kind: "transform";
  matrix: Matrix;
  /** The selected pixels, as in `FillStroke`; null: all. */
  runs: readonly number[] | null;
}

export type DrawnStroke = BrushStroke | SmudgeStroke;
export type Stroke = DrawnStroke | FillStroke | TransformStroke;

export interface PictureLayer {
  id: string;
  name: string;
  opacity: number;
  visible: boolean;
  /** Asset id of a picture below the strokes. */
  base: string | null;
  strokes: readonly Stroke[];
  /** Asset id of a picture whose opacity says where the layer is visible. */
  mask?: string | null;
  blend?: PaintBlend;
  /** Whether it is visible only where the layer below it is. */
  clip?: boolean;
  /** Whether strokes leave its opacity as it is. */
  locked?: boolean;
  /** Whether it is a group of the layers that name it as their parent, which precede it. */
  group?: boolean;
  parent?: string | null;
}

/** A painted key in its editable form; layers from back to front. */
export interface KeyPicture {
  layers: readonly PictureLayer[];
  /** The key counts where this layer has paint; without it, everywhere. */
  mask?: PictureLayer;
  /** Of a pasted key, until it is in the document. */
  settings?: KeySettings;
}

/** How many frames before and after it a key reaches (null: up to the next key), and its weight against its neighbour. */
export interface KeySettings {
  before: number | null;
  after: number | null;
  weight: number;
}

const MIN_PRESSURE = 0.05;

/** Width of a stroke at a pressure: a fifth of the size at none, the whole size at full pressure. */
export const widthAt = (size: number, pressure: number): number =>
  size * (0.2 + 0.8 * clamp(pressure, MIN_PRESSURE, 1));

/** Whether two samples are less than `least` px apart. */
export const isNear = (a: Sample, b: Sample, least: number): boolean => distance([a[0], a[1]], [b[0], b[1]]) < least;

/** Numbers with one decimal for positions, two for pressure, whole degrees: enough for pixels, and short as JSON. */
export function rounded([x, y, pressure, tilt, lean]: Sample): Sample {
  const [column, row, force] = [Math.round(x * 10) / 10, Math.round(y * 10) / 10, Math.round(pressure * 100) / 100];
  return tilt ? [column, row, force, Math.round(tilt), Math.round(lean ?? 0)] : [column, row, force];
}

export const changePictureLayer = (
  picture: KeyPicture,
  id: string,
  change: (layer: PictureLayer) => PictureLayer,
): KeyPicture => ({
  ...picture,
  layers: picture.layers.map((layer) => (layer.id === id ? change(layer) : layer)),
  ...(picture.mask && { mask: picture.mask.id === id ? change(picture.mask) : picture.mask }),
});

export const addStroke = (picture: KeyPicture, id: string, stroke: Stroke): KeyPicture =>
  changePictureLayer(picture, id, (layer) => ({ ...layer, strokes: [...layer.strokes, stroke] }));

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

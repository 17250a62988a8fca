/** Stamps from pictures: a gray PNG whose white is paint. */

import { decode, encode } from "fast-png";
import { clamp } from "./geometry";

interface Level {
  width: number;
  height: number;
  /** 0..1, row by row. */
  values: Float32Array;
}

/** A picture at its own size, and at halves of it, for stamps that are smaller. */
export class Picture {
  private readonly levels: Level[];

  constructor(whole: Level) {
    this.levels = [whole];
    for (let last = whole; Math.max(last.width, last.height) > 2; ) {
      last = halved(last);
      this.levels.push(last);
    }
  }

  /** The smallest level that is not coarser than stamps of this many px. */
  for(side: number): Level {
    const fine = this.levels.findLast(({ width, height }) => Math.max(width, height) >= side);
    return fine ?? (this.levels[0] as Level);
  }
}

function halved({ width, height, values }: Level): Level {
  const [columns, rows] = [Math.max(1, width >> 1), Math.max(1, height >> 1)];
  const small = new Float32Array(columns * rows);
  const at = (x: number, y: number) => values[Math.min(y, height - 1) * width + Math.min(x, width - 1)] ?? 0;
  for (let y = 0; y < rows; y++)
    for (let x = 0; x < columns; x++)
      small[y * columns + x] =
        (at(2 * x, 2 * y) + at(2 * x + 1, 2 * y) + at(2 * x, 2 * y + 1) + at(2 * x + 1, 2 * y + 1)) / 4;
  return { width: columns, height: rows, values: small };
}

/** Value at (u, v), -1..1 along the longer side; 0 outside; bilinear. */
export function coverageIn({ width, height, values }: Level, u: number, v: number): number {
  const half = Math.max(width, height) / 2;
  const x = u * half + width / 2 - 0.5;
  const y = v * half + height / 2 - 0.5;
  if (x <= -1 || y <= -1 || x >= width || y >= height) return 0;
  const [i, j] = [Math.floor(x), Math.floor(y)];
  const at = (column: number, row: number) =>
    column < 0 || row < 0 || column >= width || row >= height ? 0 : (values[row * width + column] ?? 0);
  const top = at(i, j) + (x - i) * (at(i + 1, j) - at(i, j));
  const bottom = at(i, j + 1) + (x - i) * (at(i + 1, j + 1) - at(i, j + 1));
  return top + (y - j) * (bottom - top);
}

const known = new Map<string, Picture>();

/** The picture of a tip. Throws an Error if the text is no gray PNG. */
export function pictureOf(text: string): Picture {
  const found = known.get(text) ?? new Picture(decoded(text));
  known.set(text, found);
  return found;
}

function decoded(text: string): Level {
  const { width, height, channels, depth, data } = decode(
    Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)),
  );
  if (channels !== 1 || depth !== 8) throw new Error("The picture of a brush is a gray PNG of 8 bit.");
  return { width, height, values: Float32Array.from(data, (value) => value / 255) };
}

/** Longest side of a brush's picture, px: it travels with the strokes. */
export const TIP_PX = 128;

/** A tip's picture as text, from its paint 0..255, row by row; it is cut to what is painted, and made smaller if it must be. */
export function tipPicture(width: number, height: number, paint: Uint8Array): string {
  const box = painted(width, height, paint);
  if (!box) throw new Error("The picture has no paint: it is empty, or white all over.");
  let level: Level = { width: box.width, height: box.height, values: box.values };
  while (Math.max(level.width, level.height) > TIP_PX) level = halved(level);
  const data = Uint8Array.from(level.values, (value) => Math.round(clamp(value, 0, 1) * 255));
  const png = encode({ width: level.width, height: level.height, data, depth: 8, channels: 1 });
  return btoa(String.fromCharCode(...png));
}

/** The smallest box with all paint; null: there is none. */
function painted(width: number, height: number, paint: Uint8Array): Level | null {
  let [left, top, right, bottom] = [width, height, -1, -1];
  for (let y = 0; y < height; y++)
    for (let x = 0; x < width; x++)
      if (paint[y * width + x]) {
        [left, right] = [Math.min(left, x), Math.max(right, x)];
        [top, bottom] = [Math.min(top, y), Math.max(bottom, y)];
      }
  if (right < 0) return null;
  const [columns, rows] = [right - left + 1, bottom - top + 1];
  const values = new Float32Array(columns * rows);
  for (let y = 0; y < rows; y++)
    for (let x = 0; x < columns; x++) values[y * columns + x] = (paint[(top + y) * width + left + x] ?? 0) / 255;
  return { width: columns, height: rows, values };
}

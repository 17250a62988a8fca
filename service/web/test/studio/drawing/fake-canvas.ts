/** As much of a canvas as layers use: pixels, rectangles, and one picture on another. */

import { vi } from "vitest";

interface Box {
  x: number;
  y: number;
  width: number;
  height: number;
}

class FakeContext {
  data = new Uint8ClampedArray(0);
  globalAlpha = 1;
  globalCompositeOperation = "source-over";
  fillStyle = "#000000";
  private clipped: Box | null = null;
  private wanted: Box | null = null;
  private readonly saved: [number, string, Box | null][] = [];

  constructor(readonly canvas: FakeCanvas) {}

  save = () => this.saved.push([this.globalAlpha, this.globalCompositeOperation, this.clipped]);
  restore = () => {
    const last = this.saved.pop();
    if (last) [this.globalAlpha, this.globalCompositeOperation, this.clipped] = last;
  };
  beginPath = () => {};
  rect = (x: number, y: number, width: number, height: number) => {
    this.wanted = { x, y, width, height };
  };
  clip = () => {
    this.clipped = this.wanted;
  };

  /** Indices of the pixels of a box that can be changed. */
  private each({ x, y, width, height }: Box, act: (at: number, column: number, row: number) => void): void {
    const clip = this.clipped ?? { x: 0, y: 0, width: this.canvas.width, height: this.canvas.height };
    for (let row = Math.max(y, clip.y); row < Math.min(y + height, clip.y + clip.height); row++)
      for (let column = Math.max(x, clip.x); column < Math.min(x + width, clip.x + clip.width); column++)
        act(4 * (row * this.canvas.width + column), column - x, row - y);
  }

  clearRect(x: number, y: number, width: number, height: number): void {
    this.each({ x, y, width, height }, (at) => this.data.fill(0, at, at + 4));
  }

  fillRect(x: number, y: number, width: number, height: number): void {
    const hex = this.fillStyle.startsWith("#");
    const color = hex ? [1, 3, 5].map((i) => Number.parseInt(this.fillStyle.slice(i, i + 2), 16)) : [24, 18, 40];
    this.each({ x, y, width, height }, (at) => this.lay(at, [...color, hex ? 255 : 153]));
  }

  drawImage(from: FakeCanvas, ...places: number[]): void {
    const [x = 0, y = 0, width = from.width, height = from.height, left = x, top = y] =
      places.length > 2 ? places : [0, 0, from.width, from.height, places[0], places[1]];
    const { data } = from.context;
    this.each({ x: left, y: top, width, height }, (at, column, row) => {
      const source = 4 * ((y + row) * from.width + x + column);
      this.lay(at, data.slice(source, source + 4));
    });
  }

  private lay(at: number, [red = 0, green = 0, blue = 0, opaque = 0]: ArrayLike<number> & Iterable<number>): void {
    const how = this.globalCompositeOperation;
    const share = (opaque / 255) * this.globalAlpha;
    const behind = (this.data[at + 3] ?? 0) / 255;
    const shares: Record<string, [own: number, kept: number]> = {
      "destination-in": [0, share],
      "destination-out": [0, 1 - share],
      lighter: [share, 1],
    };
    const [own, kept] = shares[how] ?? [share, 1 - share];
    const alpha = Math.min(1, own + behind * kept);
    [red, green, blue].forEach((value, i) => {
      const below = this.data[at + i] ?? 0;
      const color = how === "multiply" ? value * (1 - behind + (behind * below) / 255) : value;
      this.data[at + i] = alpha ? (color * own + below * behind * kept) / alpha : 0;
    });
    this.data[at + 3] = 255 * alpha;
  }

  getImageData(left: number, top: number, width: number, height: number) {
    const box = new Uint8ClampedArray(4 * width * height);
    for (let y = 0; y < height; y++)
      for (let x = 0; x < width; x++) {
        const [column, row] = [left + x, top + y];
        if (column < 0 || row < 0 || column >= this.canvas.width || row >= this.canvas.height) continue;
        const at = 4 * (row * this.canvas.width + column);
        box.set(this.data.subarray(at, at + 4), 4 * (y * width + x));
      }
    return { data: box, width, height };
  }

  putImageData(box: { data: Uint8ClampedArray; width: number; height: number }, left: number, top: number): void {
    for (let y = 0; y < box.height; y++)
      for (let x = 0; x < box.width; x++) {
        const [column, row] = [left + x, top + y];
        if (column < 0 || row < 0 || column >= this.canvas.width || row >= this.canvas.height) continue;
        const from = 4 * (y * box.width + x);
        this.data.set(box.data.subarray(from, from + 4), 4 * (row * this.canvas.width + column));
      }
  }
}

export class FakeCanvas {
  width = 0;
  height = 0;
  readonly context = new FakeContext(this);

  getContext(): FakeContext {
    if (!this.context.data.length) this.context.data = new Uint8ClampedArray(4 * this.width * this.height);
    return this.context;
  }
}

/** Canvases are made of these until `vi.unstubAllGlobals`. */
export const fakeCanvases = () => vi.stubGlobal("document", { createElement: () => new FakeCanvas() });

export const pixelsOf = (canvas: HTMLCanvasElement): Uint8ClampedArray =>
  (canvas as unknown as FakeCanvas).context.data;

/** Canvases that stay in the memory of the processor: their pixels are read often. */

import type { Size } from "./geometry";

export type Context = CanvasRenderingContext2D;

export function createCanvas({ width, height }: Size): [HTMLCanvasElement, Context] {
  const canvas = document.createElement("canvas");
  Object.assign(canvas, { width, height });
  const context = canvas.getContext("2d", { willReadFrequently: true });
  if (!context) throw new Error("The browser gave no canvas.");
  return [canvas, context];
}

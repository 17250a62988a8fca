/** The area of a fill in a canvas, found in a worker. */

import { type FillOptions, floodRuns } from "./fill";
import type { FillRequest } from "./fill-worker";
import { workerCalls } from "./worker-calls";

const find = workerCalls<FillRequest, number[]>(
  () => new Worker(new URL("./fill-worker.ts", import.meta.url), { type: "module" }),
);

/** As `floodRuns`, of the pixels that the canvas has now; without a worker, the page finds them. */
export async function fillRuns(
  canvas: HTMLCanvasElement,
  start: readonly [number, number],
  options: FillOptions,
): Promise<number[]> {
  const { width, height } = canvas;
  if (typeof OffscreenCanvas === "function") {
    const picture = await createImageBitmap(canvas);
    const found = await find({ picture, start, options }, [picture]);
    if (found) return found;
  }
  const pixels = canvas.getContext("2d")?.getImageData(0, 0, width, height);
  return pixels ? floodRuns(pixels.data, { width, height }, start, options) : [];
}

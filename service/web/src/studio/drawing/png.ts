/** Canvases as PNG, encoded in a worker. */

import { workerCalls } from "./worker-calls";

const encode = workerCalls<ImageBitmap, Blob>(
  () => new Worker(new URL("./png-worker.ts", import.meta.url), { type: "module" }),
);

/** A canvas as PNG; without a worker, the page encodes it: the canvas must not change until then. Throws an Error if the browser
 * cannot write it. */
export async function pngOf(canvas: HTMLCanvasElement): Promise<Blob> {
  const blob = (await inWorker(canvas)) ?? (await here(canvas));
  if (!blob) throw new Error("The browser could not write the PNG.");
  return blob;
}

const here = (canvas: HTMLCanvasElement): Promise<Blob | null> =>
  new Promise((done) => canvas.toBlob(done, "image/png"));

async function inWorker(canvas: HTMLCanvasElement): Promise<Blob | undefined> {
  if (typeof OffscreenCanvas !== "function") return undefined;
  const picture = await createImageBitmap(canvas);
  return encode(picture, [picture]);
}

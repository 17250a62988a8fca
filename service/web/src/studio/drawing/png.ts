/** Canvases as PNG, encoded in a worker. */

import type { EncodeAnswer, EncodeRequest } from "./png-worker";

const waiting = new Map<number, (blob: Blob | undefined) => void>();
let worker: Worker | undefined;
let asked = 0;

/**
 * A canvas as PNG. Without a worker, for example because the connection was lost before its program was loaded, the page
 * encodes it; the canvas must not change until then. Throws an Error if the browser cannot write it.
 */
export async function pngOf(canvas: HTMLCanvasElement): Promise<Blob> {
  const beside = typeof OffscreenCanvas === "function" ? await inWorker(canvas) : undefined;
  const blob = beside ?? (await here(canvas));
  if (!blob) throw new Error("The browser could not write the PNG.");
  return blob;
}

const here = (canvas: HTMLCanvasElement): Promise<Blob | null> =>
  new Promise((done) => canvas.toBlob(done, "image/png"));

async function inWorker(canvas: HTMLCanvasElement): Promise<Blob | undefined> {
  const request: EncodeRequest = { id: ++asked, picture: await createImageBitmap(canvas) };
  worker ??= startWorker();
  const answer = new Promise<Blob | undefined>((done) => waiting.set(request.id, done));
  worker.postMessage(request, [request.picture]);
  return answer;
}

function startWorker(): Worker {
  const made = new Worker(new URL("./png-worker.ts", import.meta.url), { type: "module" });
  made.onmessage = ({ data: { id, blob } }: MessageEvent<EncodeAnswer>) => {
    waiting.get(id)?.(blob);
    waiting.delete(id);
  };
  made.onerror = () => {
    for (const done of waiting.values()) done(undefined);
    waiting.clear();
    worker = undefined;
  };
  return made;
}

/** A canvas becomes a PNG even where the worker that encodes it cannot be loaded. */

import { afterEach, describe, expect, it, vi } from "vitest";
import { pngOf } from "../../../src/studio/drawing/png";

const canvas = (blob: Blob | null) =>
  ({ toBlob: (done: (blob: Blob | null) => void) => done(blob) }) as unknown as HTMLCanvasElement;

/** A worker whose program cannot be loaded: the connection is lost. */
class Unreachable {
  onmessage: unknown = null;
  onerror: (() => void) | null = null;

  postMessage(): void {
    queueMicrotask(() => this.onerror?.());
  }
}

describe("a canvas as PNG", () => {
  afterEach(() => vi.unstubAllGlobals());

  const withoutWorker = () => {
    vi.stubGlobal("OffscreenCanvas", class {});
    vi.stubGlobal("createImageBitmap", async () => ({}));
    vi.stubGlobal("Worker", Unreachable);
  };

  it("is encoded by the page if the worker cannot be loaded", async () => {
    withoutWorker();
    const blob = new Blob(["png"]);
    expect(await pngOf(canvas(blob))).toBe(blob);
  });

  it("is an error if the page cannot encode it either", async () => {
    withoutWorker();
    await expect(pngOf(canvas(null))).rejects.toThrow("could not write the PNG");
  });
});

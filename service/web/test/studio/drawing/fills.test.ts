/** The area of a fill is found also where the worker cannot be loaded. */

import { afterEach, expect, test, vi } from "vitest";
import { fillRuns } from "../../../src/studio/drawing/fills";

afterEach(() => vi.unstubAllGlobals());

test("the page fills if the worker cannot be loaded", async () => {
  vi.stubGlobal("OffscreenCanvas", class {});
  vi.stubGlobal("createImageBitmap", async () => ({}));
  vi.stubGlobal(
    "Worker",
    class {
      onerror: (() => void) | null = null;
      postMessage = () => queueMicrotask(() => this.onerror?.());
    },
  );
  const data = Uint8ClampedArray.from([0, 0, 9, 9].flatMap((gray) => [gray, gray, gray, 255]));
  const canvas = { width: 4, height: 1, getContext: () => ({ getImageData: () => ({ data }) }) };
  expect(await fillRuns(canvas as unknown as HTMLCanvasElement, [2.5, 0.5], { tolerance: 3 })).toEqual([2, 2]);
});

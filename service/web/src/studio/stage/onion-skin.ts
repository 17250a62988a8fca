/** Frames before and after the shown one, half transparent over the key that is painted. */

import { effect, untracked } from "@preact/signals";
import { isAbort } from "../../api/http";
import { copyFrame } from "../previews/frames";
import type { Store } from "../state/store";

/** Opacity of the nearest frame on each side; each further one has half of it. */
const ALPHA = 0.3;

export interface OnionSkin {
  /** The context is in pixels of the video. */
  draw(context: CanvasRenderingContext2D): void;
  close(): void;
}

export function createOnionSkin(store: Store, redraw: () => void): OnionSkin {
  /** Frames of the video, by number. */
  const sources = new Map<number, ImageBitmap>();
  const asked = new Set<number>();
  let closed = false;

  /** Frames from the farthest to the nearest, with their opacities. */
  function around(): [frame: number, alpha: number][] {
    const { frames } = store.drawing.onion.value;
    const [first, end] = store.reach.value;
    const steps = Array.from({ length: frames }, (_, i) => frames - i);
    return steps
      .flatMap((step): [number, number][] => [
        [store.frame.value - step, ALPHA / 2 ** (step - 1)],
        [store.frame.value + step, ALPHA / 2 ** (step - 1)],
      ])
      .filter(([frame]) => frame >= first && frame < end);
  }

  async function load(frame: number): Promise<void> {
    asked.add(frame);
    const wanted = () => !closed && untracked(() => around().some(([one]) => one === frame));
    try {
      const picture = await copyFrame(store.asset, frame, wanted);
      if (closed) return picture.close();
      sources.set(frame, picture);
      redraw();
    } catch (error) {
      if (!isAbort(error)) console.info(`Impasto: frame ${frame + 1} is not shown as onion skin.`, error);
    } finally {
      asked.delete(frame);
    }
  }

  const stop = effect(() => {
    const shown = store.drawing.onion.value.show === "source" ? around().map(([frame]) => frame) : [];
    for (const [frame, picture] of sources) {
      if (shown.includes(frame)) continue;
      picture.close();
      sources.delete(frame);
    }
    for (const frame of shown) if (!sources.has(frame) && !asked.has(frame)) load(frame);
  });

  /** The painting of a neighbour: as the present key makes it, else the newest preview. */
  const painted = (frame: number): ImageBitmap | undefined =>
    store.neighbours.value.find((result) => result.frame === frame)?.picture ?? store.results.value.get(frame)?.picture;

  return {
    draw(context) {
      const { show } = store.drawing.onion.value;
      if (show === "none") return;
      const { width, height } = store.size;
      for (const [frame, alpha] of around()) {
        const picture = show === "source" ? sources.get(frame) : painted(frame);
        if (!picture) continue;
        context.globalAlpha = alpha;
        context.drawImage(picture, 0, 0, width, height);
      }
      context.globalAlpha = 1;
    },
    close() {
      closed = true;
      stop();
      for (const picture of sources.values()) picture.close();
      sources.clear();
    },
  };
}

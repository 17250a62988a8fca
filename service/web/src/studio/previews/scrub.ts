/**
 * Small frames of the video while the playhead moves: the service sends them in runs ahead of it. The stage shows them
 * until the exact frame is there; a browser needs up to a second to seek in a video with few key frames.
 */

import { isAbort } from "../../api/api";
import { pictureOf, preview } from "../document/api";
import type { Store } from "../state/store";

const SIDE_PX = 480;
/** Number of frames per request. */
const RUN = 24;
const KEPT = 200;
/** Steps of at most `STEP` frames, each within `MOVING_MS` of the last, are a movement from the third on. */
const STEP = 4;
const MOVING_MS = 400;
const MOVES = 3;

export interface ScrubFrames {
  /** The small picture of a frame, if it is here. */
  at(frame: number): ImageBitmap | undefined;
  /** The playhead is at this frame now. */
  moved(frame: number): void;
  close(): void;
}

/** The first run of frames, [start, stop), that is missing ahead of a frame; null if the next `RUN / 2` frames are known. */
export function missingRun(
  known: (frame: number) => boolean,
  frame: number,
  direction: number,
  frames: number,
): [number, number] | null {
  for (let i = 0; i < RUN / 2; i++) {
    const at = frame + i * direction;
    if (at < 0 || at >= frames) return null;
    if (known(at)) continue;
    const run: [number, number] = direction > 0 ? [at, at + RUN] : [at + 1 - RUN, at + 1];
    return [Math.max(0, run[0]), Math.min(frames, run[1])];
  }
  return null;
}

export function startScrubbing(store: Store, redraw: () => void): ScrubFrames {
  const pictures = new Map<number, ImageBitmap>();
  let running = new AbortController();
  let asked: [number, number] | null = null;
  let last = -1;
  let direction = 0;
  let moves = 0;
  let at = 0;

  function moved(frame: number): void {
    const now = performance.now();
    const step = frame - last;
    const on = step !== 0 && Math.abs(step) <= STEP && now - at < MOVING_MS && Math.sign(step) === direction;
    moves = on ? moves + 1 : 1;
    direction = Math.sign(step);
    [last, at] = [frame, now];
    if (moves >= MOVES && store.previews.peek()) fetchAhead();
  }

  function fetchAhead(): void {
    const run = missingRun((frame) => pictures.has(frame), last, direction, store.frames);
    const coming = asked && run && asked[0] <= run[0] && run[0] < asked[1];
    if (run && !coming) load(run);
  }

  async function load(run: [number, number]): Promise<void> {
    running.abort();
    running = new AbortController();
    const { signal } = running;
    asked = run;
    const { document, shot, layerId } = store;
    const place = { document: document.peek(), shot: shot.peek().id, layer: layerId.peek() };
    try {
      await preview({
        project: store.projectId,
        what: "source",
        channel: "scrub",
        body: { ...place, frames: run, max_side_px: SIDE_PX, format: "jpeg" },
        signal,
        async onrecord(record) {
          if (record.header.type === "frame") keep(record.header.frame, await pictureOf(record));
        },
      });
    } catch (error) {
      if (!isAbort(error)) console.info("Impasto: no small frames.", error);
    }
    if (signal.aborted) return;
    asked = null;
    if (performance.now() - at < MOVING_MS) fetchAhead();
  }

  function keep(frame: number, picture: ImageBitmap): void {
    pictures.get(frame)?.close();
    pictures.set(frame, picture);
    for (const [old, oldest] of pictures) {
      if (pictures.size <= KEPT) break;
      oldest.close();
      pictures.delete(old);
    }
    if (frame === store.frame.peek()) redraw();
  }

  return {
    at: (frame) => pictures.get(frame),
    moved,
    close() {
      running.abort();
      for (const picture of pictures.values()) picture.close();
      pictures.clear();
    },
  };
}

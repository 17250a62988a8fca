/** Finds the first frames of the video's shots: automatically in a short video, on request in a long one. */

import { computed, effect, type ReadonlySignal, signal, untracked } from "@preact/signals";
import { isAbort } from "../../api/api";
import { preview } from "../document/api";
import type { Store } from "../state/store";

/** A video of at most this many frames is looked through once the playhead has rested: it takes the processors. */
const SHORT_FRAMES = 1500;
const REST_MS = 3000;

export interface Cuts {
  /** Share of the video that was searched; null: no search is running. */
  readonly done: ReadonlySignal<number | null>;
  /** Whether it has been looked through with the present settings. */
  readonly known: ReadonlySignal<boolean>;
  /** Whether the video is so long that the user decides. */
  readonly asked: boolean;
  find(): Promise<void>;
  close(): void;
}

export function followCuts(store: Store): Cuts {
  const done = signal<number | null>(null);
  const known = signal(false);
  let running = new AbortController();
  let timer = 0;

  /** The data on which the cuts depend. */
  const asked = computed(() => {
    const { id, source, params } = store.layer.value;
    return JSON.stringify([id, source, params?.[store.method.value?.studio.cuts ?? ""]]);
  });

  const dispose = effect(() => {
    asked.value;
    const available = store.previews.value;
    stop();
    known.value = false;
    store.cuts.value = [];
    if (available) findAtRest();
  });
  const disposeFrame = effect(() => {
    store.frame.value;
    untracked(findAtRest);
  });

  function findAtRest(): void {
    clearTimeout(timer);
    const open = store.previews.peek() && !known.peek() && done.peek() === null;
    if (open && store.frames <= SHORT_FRAMES) timer = window.setTimeout(find, REST_MS);
  }

  function stop(): void {
    clearTimeout(timer);
    running.abort();
    done.value = null;
  }

  async function find(): Promise<void> {
    stop();
    running = new AbortController();
    const { signal: wanted } = running;
    done.value = 0;
    const place = { document: store.document.peek(), shot: store.shot.peek().id, layer: store.layerId.peek() };
    try {
      await preview({
        project: store.projectId,
        what: "cuts",
        channel: "cuts",
        body: place,
        signal: wanted,
        onrecord({ header }) {
          if (wanted.aborted) return;
          if (header.type === "progress") done.value = header.done;
          if (header.type === "progress" || header.type === "cuts") store.cuts.value = header.cuts ?? [];
          if (header.type === "cuts") known.value = true;
        },
      });
    } catch (error) {
      if (!isAbort(error)) console.info("Impasto: no cuts.", error);
    } finally {
      if (!wanted.aborted) done.value = null;
    }
  }

  return {
    done,
    known,
    asked: store.frames > SHORT_FRAMES,
    find,
    close() {
      dispose();
      disposeFrame();
      stop();
    },
  };
}

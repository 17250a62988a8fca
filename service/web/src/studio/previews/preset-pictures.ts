/** Presets as pictures of the shown frame, painted while the user rests: the stage's own preview goes first. */

import { effect, untracked } from "@preact/signals";
import type { Params } from "../../api/schemas";
import type { Presets } from "../../forms/method-cards";
import type { Store } from "../state/store";
import { paintCards } from "./cards";

const REST_MS = 1000;

/** Show pictures on the presets of the selected layer until the returned function is called. */
export function followPresets(store: Store, presets: Presets): () => void {
  let running = new AbortController();
  let timer = 0;
  /** Layer and frame whose pictures are complete. */
  let painted = "";

  const dispose = effect(() => {
    if (store.previews.value) presets.expectPictures(store.size.width / store.size.height);
    const frame = store.frame.value;
    const key = `${store.layer.value.id} ${frame}`;
    const ready = store.previews.value && store.results.value.get(frame)?.final;
    store.document.value;
    if (painted === key) return;
    stop();
    if (ready) timer = window.setTimeout(() => untracked(() => paint(key)), REST_MS);
  });

  async function paint(key: string): Promise<void> {
    running = new AbortController();
    const { signal } = running;
    const present = store.layer.peek().params ?? {};
    const cards = presets.all.map(({ name, params }) => ({ id: name, set: { params: replacing(present, params) } }));
    await paintCards(store, "presets", cards, signal, presets.picture);
    if (!signal.aborted) painted = key;
  }

  function stop(): void {
    clearTimeout(timer);
    running.abort();
  }

  return () => {
    dispose();
    stop();
  };
}

/** A merge patch that puts `wanted` in the place of all present parameters. */
export const replacing = (present: Params, wanted: Params): Record<string, unknown> => ({
  ...Object.fromEntries(Object.keys(present).map((name) => [name, null])),
  ...wanted,
});

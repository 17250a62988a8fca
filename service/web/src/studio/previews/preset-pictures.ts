/** Presets as pictures of the shown frame, painted while the user rests: the stage's own preview goes first. */

import { useEffect, useState } from "preact/hooks";
import type { Example, Params } from "../../api/schemas";
import { presetsOf } from "../../forms/method-cards";
import type { Store } from "../state/store";
import { paintCards } from "./cards";

const REST_MS = 1000;

/** Object URLs by name of the example; null without previews. They stay until those of another frame come. */
export function usePresetPictures(store: Store, examples: Example[]): ReadonlyMap<string, string> | null {
  const [pictures, setPictures] = useState<ReadonlyMap<string, string>>(new Map());
  const [painted, setPainted] = useState("");
  const frame = store.frame.value;
  const key = `${store.layer.value.id} ${frame}`;
  const ready = store.previews.value && store.results.value.get(frame)?.final && painted !== key;
  useEffect(() => {
    if (!ready) return;
    const controller = new AbortController();
    const show = (name: string, picture: Blob) =>
      setPictures((old) => {
        URL.revokeObjectURL(old.get(name) ?? "");
        return new Map(old).set(name, URL.createObjectURL(picture));
      });
    const timer = setTimeout(async () => {
      const present = store.layer.peek().params ?? {};
      const cards = presetsOf(examples).map(({ name, params }) => ({
        id: name,
        set: { params: replacing(present, params) },
      }));
      await paintCards(store, "presets", cards, controller.signal, show);
      if (!controller.signal.aborted) setPainted(key);
    }, REST_MS);
    return () => {
      clearTimeout(timer);
      controller.abort();
    };
  }, [key, ready, store.document.value]);
  return store.previews.value ? pictures : null;
}

/** A merge patch that puts `wanted` in the place of all present parameters. */
const replacing = (present: Params, wanted: Params): Record<string, unknown> => ({
  ...Object.fromEntries(Object.keys(present).map((name) => [name, null])),
  ...wanted,
});

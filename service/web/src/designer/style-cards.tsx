/** Styles as cards: pictures of the user's own frame where the service makes them, else names. */

import { useEffect, useState } from "preact/hooks";
import { asProblem, isAbort } from "../shared/api";
import { humanise } from "../shared/format";
import { preview } from "./api";
import type { Store } from "./store";

const SIDE_PX = 160;

export interface StyleCardsProps {
  store: Store;
  names: readonly string[];
  chosen: string;
  onChoose(name: string): void;
}

export function StyleCards({ store, names, chosen, onChoose }: StyleCardsProps) {
  const pictures = usePictures(store, names);
  return (
    <div class="style-cards" role="group" aria-label="Styles">
      {names.map((name) => (
        <button
          key={name}
          type="button"
          class="style-card"
          aria-pressed={name === chosen}
          onClick={() => onChoose(name)}
        >
          {pictures.has(name) && <img src={pictures.get(name)} alt="" />}
          <span>{name === "van-gogh" ? "Van Gogh" : humanise(name)}</span>
        </button>
      ))}
    </div>
  );
}

/** The first shown frame in each style, as object URLs. */
function usePictures(store: Store, names: readonly string[]): ReadonlyMap<string, string> {
  const [pictures, setPictures] = useState<ReadonlyMap<string, string>>(new Map());
  const available = store.previews.value;
  useEffect(() => {
    if (!available) return;
    const controller = new AbortController();
    const urls: string[] = [];
    const cards = names.map((name) => ({ id: name, set: { params: { style: name } } }));
    const document = store.document.value;
    const place = { document, shot: store.shot.value.id, layer: store.layer.value.id, frame: store.frame.value };
    preview({
      project: store.projectId,
      what: "styles",
      channel: "styles",
      body: { ...place, cards, max_side_px: SIDE_PX },
      signal: controller.signal,
      onrecord({ header, payload }) {
        if (header.type !== "frame" || !header.card) return;
        const card = header.card;
        const url = URL.createObjectURL(new Blob([payload], { type: header.media_type }));
        urls.push(url);
        setPictures((known) => new Map(known).set(card, url));
      },
    }).catch((error) => {
      if (isAbort(error) || asProblem(error).status === 404) return;
      console.info("Impasto: no style cards.", error);
    });
    return () => {
      controller.abort();
      for (const url of urls) URL.revokeObjectURL(url);
    };
  }, [available]);
  return pictures;
}

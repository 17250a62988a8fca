/** Styles as cards: pictures of the user's own frame where the service makes them, else names. */

import { useEffect, useState } from "preact/hooks";
import { humanise } from "../../ui/format";
import { paintCards } from "../previews/cards";
import type { Store } from "../state/store";

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
          {pictures.has(name) ? (
            <img src={pictures.get(name)} alt="" />
          ) : (
            store.previews.value && <span class="card-blank" />
          )}
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
    paintCards(store, "styles", cards, controller.signal, (card, picture) => {
      const url = URL.createObjectURL(picture);
      urls.push(url);
      setPictures((known) => new Map(known).set(card, url));
    });
    return () => {
      controller.abort();
      for (const url of urls) URL.revokeObjectURL(url);
    };
  }, [available]);
  return pictures;
}

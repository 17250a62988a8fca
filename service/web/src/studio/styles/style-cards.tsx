/** Styles as cards: pictures of the user's own frame where the service makes them, else names. */

import { useEffect, useState } from "preact/hooks";
import type { Section } from "../../api/schemas";
import { paintCards } from "../previews/cards";
import type { Store } from "../state/store";

export interface StyleCardsProps {
  store: Store;
  section: Section;
  chosen: string;
  onChoose(name: string): void;
}

export function StyleCards({ store, section, chosen, onChoose }: StyleCardsProps) {
  const pictures = usePictures(store, section);
  return (
    <div class="style-cards" role="group" aria-label="Styles">
      {section.styles.map(({ value, title }) => (
        <button
          key={value}
          type="button"
          class="style-card"
          aria-pressed={value === chosen}
          onClick={() => onChoose(value)}
        >
          {pictures.has(value) ? (
            <img src={pictures.get(value)} alt="" />
          ) : (
            store.previews.value && <span class="card-blank" />
          )}
          <span>{title}</span>
        </button>
      ))}
    </div>
  );
}

/** The first shown frame in each style, as object URLs. */
function usePictures(store: Store, { styles, style_param: param }: Section): ReadonlyMap<string, string> {
  const [pictures, setPictures] = useState<ReadonlyMap<string, string>>(new Map());
  const available = store.previews.value;
  useEffect(() => {
    if (!available) return;
    const controller = new AbortController();
    const urls: string[] = [];
    const cards = styles.map(({ value }) => ({ id: value, set: { params: { [param]: value } } }));
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

/** Small pictures of one frame of the layer, each with some of its settings changed. */

import { asProblem, isAbort } from "../../api/api";
import { preview } from "../document/api";
import type { Store } from "../state/store";

const SIDE_PX = 160;

export interface Card {
  id: string;
  /** JSON Merge Patch on the layer. */
  set: Record<string, unknown>;
}

/** Paint the shown frame for every card; `onpicture` is called for each picture. Does nothing if the service paints none. */
export async function paintCards(
  store: Store,
  channel: string,
  cards: readonly Card[],
  signal: AbortSignal,
  onpicture: (card: string, picture: Blob) => void,
): Promise<void> {
  if (store.removed) return;
  const document = store.document.peek();
  const place = { document, shot: store.shot.peek().id, layer: store.layerId.peek(), frame: store.frame.peek() };
  try {
    await preview({
      project: store.projectId,
      what: "styles",
      channel,
      body: { ...place, cards, max_side_px: SIDE_PX },
      signal,
      onrecord({ header, payload }) {
        if (header.type === "frame" && header.card)
          onpicture(header.card, new Blob([payload], { type: header.media_type }));
      },
    });
  } catch (error) {
    if (!isAbort(error) && asProblem(error).status !== 404) console.info("Impasto: no cards.", error);
  }
}

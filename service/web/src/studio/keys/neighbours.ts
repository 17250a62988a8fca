/**
 * The frames around a painted key, repainted from it whenever it changes. A small copy of the key is sent with the request,
 * so that they need not wait for the upload of the key itself.
 */

import { effect, untracked } from "@preact/signals";
import { asProblem, isAbort } from "../../api/api";
import { type PreviewOptions, pictureOf, preview } from "../document/api";
import type { KeyPicture } from "../drawing/strokes";
import type { Store } from "../state/store";
import type { PaintedKeys } from "./keys";

/** Frames on each side of a key. */
const AROUND = 3;
/** Longest side of the copy and of the repainted frames; the service works at no larger size. */
const PROXY_PX = 480;
/** Strokes that follow each other faster are repainted together. */
const REST_MS = 30;
/** Time after which a request to a busy service is repeated. */
const AGAIN_MS = 1000;

export interface Neighbours {
  /** Let the service prepare for a key at that frame: the first repainting is slow. */
  prepare(frame: number): Promise<void>;
  close(): void;
}

export function startNeighbours(store: Store, keys: PaintedKeys): Neighbours {
  const sent = new Map<string, KeyPicture>();
  let running = new AbortController();
  let timer = 0;
  /** Number of repaintings that wait or run. */
  let repainting = 0;
  let shownAround = -1;

  const dispose = effect(() => {
    const frame = store.frame.value;
    const section = store.section("keys");
    const key = store.pictureKey(frame, section);
    const picture = store.history.value.present.pictures[key];
    if (!picture || !section || !store.previews.value || sent.get(key) === picture) return;
    sent.set(key, picture);
    schedule(frame, picture, REST_MS);
  });

  function schedule(frame: number, picture: KeyPicture, afterMs: number): void {
    if (timer) repainting--;
    clearTimeout(timer);
    repainting++;
    timer = window.setTimeout(() => {
      timer = 0;
      untracked(() => repaint(frame, picture)).finally(() => repainting--);
    }, afterMs);
  }

  async function repaint(frame: number, picture: KeyPicture): Promise<void> {
    const document = store.document.value;
    const layer = store.layerId.value;
    try {
      await ask(frame, picture, async (record, signal) => {
        if (record.header.type !== "frame") return;
        const { frame: at, scale, final } = record.header;
        const result = { frame: at, picture: await pictureOf(record), scale, final, document, layer };
        if (signal.aborted) return;
        const others = shownAround === frame ? store.neighbours.value.filter((other) => other.frame !== at) : [];
        shownAround = frame;
        store.neighbours.value = [...others, result].sort((a, b) => a.frame - b.frame);
        if (at !== frame) store.showResult({ ...result, final: false });
      });
    } catch (error) {
      if (isAbort(error)) return;
      const { status, message } = asProblem(error);
      const current =
        sent.get(store.pictureKey(frame, store.section("keys"))) === picture && store.frame.value === frame;
      if (status === 503 && current && !timer) schedule(frame, picture, AGAIN_MS);
      else if (status !== 404 && status !== 503) store.problem.value = message;
    }
  }

  type OnRecord = (record: Parameters<PreviewOptions["onrecord"]>[0], signal: AbortSignal) => void;

  async function ask(frame: number, picture: KeyPicture, onrecord: OnRecord): Promise<void> {
    running.abort();
    running = new AbortController();
    const { signal } = running;
    const place = { document: store.document.value, shot: store.shot.value.id, layer: store.layerId.value };
    const image = await base64(await keys.small(frame, picture, PROXY_PX));
    if (signal.aborted) return;
    await preview({
      project: store.projectId,
      what: "propagate",
      channel: "neighbours",
      body: { ...place, key: frame, image, around: AROUND, max_side_px: PROXY_PX, format: "jpeg" },
      signal,
      onrecord: (record) => onrecord(record, signal),
    });
  }

  return {
    async prepare(frame) {
      if (!store.previews.value) return;
      const picture = await keys.open(frame);
      if (!repainting) await ask(frame, picture, () => {}); // it would end a repainting that prepares as well
    },
    close() {
      dispose();
      clearTimeout(timer);
      running.abort();
    },
  };
}

/** Bytes as base64, without the prefix of a data address. */
function base64(blob: Blob): Promise<string> {
  return new Promise((resolve, reject) => {
    const reader = new FileReader();
    reader.onload = () => resolve(String(reader.result).split(",")[1] ?? "");
    reader.onerror = () => reject(reader.error);
    reader.readAsDataURL(blob);
  });
}

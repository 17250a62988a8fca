/** Single frames of an asset, decoded by the service: for videos that the browser itself cannot play. */

import * as api from "../api/api";
import type { Asset } from "../api/schemas";
import type { View } from "./dom";
import { h, type Props } from "./dom";

const SIDE_PX = 854;

/** Whether the browser may be able to play the asset; it can still find out that it cannot. */
export const mayPlay = (asset: Asset): boolean =>
  asset.media_type.startsWith("video/") && document.createElement("video").canPlayType(asset.media_type) !== "";

export interface Stills extends View {
  element: HTMLImageElement;
  /** Show a frame; fractions are cut. One request runs at a time: of many indices the newest counts. */
  show(index: number): void;
  onfail(listener: (problem: unknown) => void): void;
}

/** `props` are those of the image. */
export function createStills(assetId: string, props: Props = {}): Stills {
  const image = h("img", { class: "picture", decoding: "async", alt: "The frame, original", ...props });
  const controller = new AbortController();
  let wanted = 0;
  let shown = -1;
  let busy = false;
  let fail: (problem: unknown) => void = () => {};

  async function next(): Promise<void> {
    if (busy || controller.signal.aborted || wanted === shown) return;
    busy = true;
    shown = wanted;
    await api.objectUrl(api.paths.frame(assetId, wanted, SIDE_PX), controller.signal).then(swap, failed);
    busy = false;
    next();
  }

  async function swap(url: string): Promise<void> {
    const old = image.src;
    image.src = url;
    await image.decode().catch(() => {});
    if (old) URL.revokeObjectURL(old);
  }

  function failed(problem: unknown): void {
    const busyNow = problem instanceof api.Problem && problem.code === "busy";
    if (!busyNow && !controller.signal.aborted) fail(problem);
  }

  return {
    element: image,
    show(index) {
      wanted = Math.max(0, Math.floor(index));
      next();
    },
    onfail(listener) {
      fail = listener;
    },
    close() {
      controller.abort();
      if (image.src) URL.revokeObjectURL(image.src);
    },
  };
}

/** Single frames of an asset, decoded by the service: for originals that the browser itself cannot play. */

import * as api from "./api.js";
import { h } from "./dom.js";

const SIDE_PX = 854;

/** Whether the browser may be able to play the asset; it can still find out that it cannot. */
export const mayPlay = (asset) => asset.media_type.startsWith("video/") && document.createElement("video").canPlayType(asset.media_type) !== "";

/**
 * @param {string} assetId @param {object} props of the image
 * @returns {{element, show(index), onfail(listener), close()}} one request at a time; of many indices the newest counts
 */
export function createStills(assetId, props = {}) {
  const image = h("img", { class: "picture", decoding: "async", alt: "The frame, original", ...props });
  const life = new AbortController();
  let wanted = 0;
  let shown = -1;
  let busy = false;
  let fail = () => {};

  async function next() {
    if (busy || life.signal.aborted || wanted === shown) return;
    busy = true;
    shown = wanted;
    await api.objectUrl(api.paths.frame(assetId, wanted, SIDE_PX), life.signal).then(swap, failed);
    busy = false;
    next();
  }

  async function swap(url) {
    const old = image.src;
    image.src = url;
    await image.decode().catch(() => {});
    if (old) URL.revokeObjectURL(old);
  }

  function failed(problem) {
    if (problem.code !== "busy" && !life.signal.aborted) fail(problem);
  }

  return {
    element: image,
    show(index) {
      wanted = Math.max(0, Math.floor(index));
      next();
    },
    onfail: (listener) => (fail = listener),
    close() {
      life.abort();
      if (image.src) URL.revokeObjectURL(image.src);
    },
  };
}

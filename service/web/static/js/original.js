/** One frame of the uploaded film, shown by the browser itself; some containers it cannot play. */

import { mediaUrl, paths } from "./api.js";
import { h } from "./dom.js";

/** @returns {{element, load(asset, localUrl, frame), seek(frame), onfail(listener), close()}} */
export function createOriginal() {
  const video = h("video", { class: "picture", muted: true, playsinline: "", preload: "auto", "aria-label": "The frame, original" });
  const still = h("img", { class: "picture", alt: "The frame, original", hidden: true });
  const element = h("div", { class: "original" }, video, still);
  let fps = 25;
  let frame = 0;
  let owned = null;
  let fail = () => {};

  const goto = () => (video.currentTime = (frame + 0.5) / fps);
  video.addEventListener("loadedmetadata", goto);
  video.addEventListener("error", () => video.hasAttribute("src") && fail());
  still.addEventListener("error", () => fail());

  async function load(asset, localUrl, index) {
    fps = asset.info.fps || 25;
    frame = index;
    const picture = asset.media_type.startsWith("image/");
    video.hidden = picture;
    still.hidden = !picture;
    const url = localUrl ?? (await mediaUrl(paths.content(asset.id)));
    owned = url.startsWith("blob:") ? url : null;
    (picture ? still : video).src = url;
  }

  return {
    element,
    load: (...args) => load(...args).catch(() => fail()),
    seek(index) {
      frame = index;
      if (video.readyState > 0) goto();
    },
    onfail: (listener) => (fail = listener),
    close() {
      video.removeAttribute("src");
      video.load();
      if (owned) URL.revokeObjectURL(owned);
    },
  };
}

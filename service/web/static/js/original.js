/** One frame of the uploaded film: shown by the browser itself, or by the service where the browser cannot play it. */

import { mediaUrl, paths } from "./api.js";
import { h } from "./dom.js";
import { createStills, mayPlay } from "./stills.js";

/** @returns {{element, load(asset, localUrl, frame), seek(frame), onfail(listener), close()}} */
export function createOriginal() {
  const video = h("video", { class: "picture", muted: true, playsinline: "", preload: "auto", "aria-label": "The frame, original" });
  let stills = null;
  let assetId = "";
  let fps = 25;
  let frame = 0;
  let fail = () => {};

  const goto = () => (video.currentTime = (frame + 0.5) / fps);
  video.addEventListener("loadedmetadata", () => (video.videoWidth ? goto() : decode()));
  video.addEventListener("error", () => video.hasAttribute("src") && decode());

  /** Let the service decode from now on. */
  function decode() {
    if (stills) return;
    stills = createStills(assetId);
    stills.onfail(() => fail());
    video.replaceWith(stills.element);
    stills.show(frame);
  }

  async function load(asset, localUrl, index) {
    assetId = asset.id;
    fps = asset.info.fps || 25;
    frame = index;
    if (!mayPlay(asset)) return decode();
    video.src = localUrl ?? (await mediaUrl(paths.content(asset.id)));
  }

  return {
    element: video,
    load: (...args) => load(...args).catch(() => fail()),
    seek(index) {
      frame = index;
      if (stills) stills.show(index);
      else if (video.readyState > 0) goto();
    },
    onfail: (listener) => (fail = listener),
    close() {
      stills?.close();
      if (video.src.startsWith("blob:")) URL.revokeObjectURL(video.src);
      video.removeAttribute("src");
      video.load();
    },
  };
}

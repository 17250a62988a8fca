/** One frame of the uploaded film, shown by the browser itself; some containers it cannot play. */

import { mediaUrl, paths } from "./api.js";
import { h } from "./dom.js";

/** @returns {{element, load(asset, localUrl, frame), seek(frame), onfail(listener), close()}} */
export function createOriginal() {
  const video = h("video", { class: "picture", muted: true, playsinline: "", preload: "auto", "aria-label": "The frame, original" });
  let fps = 25;
  let frame = 0;
  let fail = () => {};

  const goto = () => (video.currentTime = (frame + 0.5) / fps);
  video.addEventListener("loadedmetadata", goto);
  video.addEventListener("error", () => video.hasAttribute("src") && fail());

  async function load(asset, localUrl, index) {
    fps = asset.info.fps || 25;
    frame = index;
    if (!asset.media_type.startsWith("video/")) return fail();
    video.src = localUrl ?? (await mediaUrl(paths.content(asset.id)));
  }

  return {
    element: video,
    load: (...args) => load(...args).catch(() => fail()),
    seek(index) {
      frame = index;
      if (video.readyState > 0) goto();
    },
    onfail: (listener) => (fail = listener),
    close() {
      if (video.src.startsWith("blob:")) URL.revokeObjectURL(video.src);
      video.removeAttribute("src");
      video.load();
    },
  };
}

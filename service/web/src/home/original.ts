/** One frame of the uploaded film: shown by the browser itself, or by the service where the browser cannot play it. */

import { mediaUrl, paths } from "../api/api";
import type { Asset } from "../api/schemas";
import type { View } from "../ui/dom";
import { h } from "../ui/dom";
import { createStills, mayPlay, type Stills } from "../ui/stills";

export interface Original extends View {
  /** `localUrl`: the file just chosen, which needs no download. */
  load(asset: Asset, localUrl: string | undefined, frame: number): void;
  seek(frame: number): void;
  onfail(listener: () => void): void;
}

export function createOriginal(): Original {
  const video = h("video", {
    class: "picture",
    muted: true,
    playsinline: "",
    preload: "auto",
    "aria-label": "The frame, original",
  });
  let stills: Stills | null = null;
  let assetId = "";
  let fps = 25;
  let frame = 0;
  let fail = () => {};

  const seekVideo = () => {
    video.currentTime = (frame + 0.5) / fps;
  };
  video.addEventListener("loadedmetadata", () => (video.videoWidth ? seekVideo() : useStills()));
  video.addEventListener("error", () => video.hasAttribute("src") && useStills());

  /** Let the service decode from now on. */
  function useStills(): void {
    if (stills) return;
    stills = createStills(assetId);
    stills.onfail(() => fail());
    video.replaceWith(stills.element);
    stills.show(frame);
  }

  async function load(asset: Asset, localUrl: string | undefined, index: number): Promise<void> {
    assetId = asset.id;
    fps = asset.info.fps || 25;
    frame = index;
    if (mayPlay(asset)) video.src = localUrl ?? (await mediaUrl(paths.content(asset.id)));
    else useStills();
  }

  return {
    element: video,
    load: (asset, localUrl, index) => void load(asset, localUrl, index).catch(() => fail()),
    seek(index) {
      frame = index;
      if (stills) stills.show(index);
      else if (video.readyState > 0) seekVideo();
    },
    onfail(listener) {
      fail = listener;
    },
    close() {
      stills?.close();
      if (video.src.startsWith("blob:")) URL.revokeObjectURL(video.src);
      video.removeAttribute("src");
      video.load();
    },
  };
}

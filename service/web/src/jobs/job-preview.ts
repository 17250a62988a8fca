/** The picture of a running job: its newest finished frame, and before that the original. */

import * as api from "../api/api";
import type { Job } from "../api/schemas";
import { h } from "../ui/dom";
import { icon } from "../ui/icons";
import { createStills, type Stills } from "../ui/stills";
import { isFinal } from "./progress";

const PREVIEW_MS = 1000;

export interface JobPreview {
  element: HTMLElement;
  update(job: Job): void;
  close(): void;
}

export function createJobPreview(id: string): JobPreview {
  const picture = h("img", { class: "picture", alt: "The newest finished frame", hidden: true });
  const original = h("video", {
    class: "picture pending",
    muted: true,
    playsinline: "",
    preload: "auto",
    tabindex: "-1",
    "aria-hidden": "true",
  });
  const words = h("p", {}, "The first frames appear here.");
  const blank = h("div", { class: "preview-blank" }, icon("brush"), words);
  const frame = h("div", { class: "frame" }, original, blank, picture);
  let busy = false;
  let last = 0;
  let started = false;
  let still: Stills | null = null;

  original.addEventListener("loadedmetadata", () => shape(original.videoWidth / original.videoHeight));
  const shape = (ratio: number) => frame.style.setProperty("--ratio", String(ratio || 16 / 9));

  async function showOriginal(assetId: string): Promise<void> {
    started = true;
    const url = await api.mediaUrl(api.paths.content(assetId)).catch(() => "");
    if (url && picture.hidden) original.src = url;
    original.addEventListener("error", () => original.hasAttribute("src") && showStill(assetId), { once: true });
  }

  /** The browser cannot play the original: show a frame of it that the service decodes. */
  function showStill(assetId: string): void {
    const made = createStills(assetId, { class: "picture pending", alt: "", "aria-hidden": "true" });
    still = made;
    made.element.addEventListener("load", () => {
      if (picture.hidden) shape(made.element.naturalWidth / made.element.naturalHeight);
    });
    original.replaceWith(made.element);
    if (picture.hidden) made.show(0);
  }

  async function update(job: Job): Promise<void> {
    if (isFinal(job)) words.textContent = "Nothing was painted.";
    if (!started) showOriginal(job.request.inputs.video ?? "");
    const name = ["preview", "poster"].find((file) => job.results.includes(file));
    if (!name || busy || Date.now() - last < PREVIEW_MS) return;
    busy = true;
    await api.objectUrl(api.paths.file(id, name)).then(show, () => {});
    last = Date.now();
    busy = false;
  }

  async function show(url: string): Promise<void> {
    const old = picture.src;
    picture.src = url;
    await picture.decode().catch(() => {});
    shape(picture.naturalWidth / picture.naturalHeight);
    picture.hidden = false;
    original.hidden = blank.hidden = true;
    if (still) still.element.hidden = true;
    if (old) URL.revokeObjectURL(old);
  }

  function close(): void {
    still?.close();
    for (const url of [picture.src, original.src]) if (url.startsWith("blob:")) URL.revokeObjectURL(url);
    original.removeAttribute("src");
    original.load();
  }

  return { element: h("div", { class: "job-preview" }, frame), update, close };
}

/** The studio before there is a video: drop one, pick one, or try the sample. */

import { ACCEPT, acceptDrops, createDropzone } from "../forms/dropzone";
import { asProblem, isAbort, request } from "../shared/api";
import { under } from "../shared/base";
import { fill, h } from "../shared/dom";
import { bytes, percent } from "../shared/format";
import { icon } from "../shared/icons";
import { problemBlock } from "../shared/notices";
import type { Asset, View } from "../shared/types";
import { upload } from "../shared/upload";

const SAMPLE = { path: "/static/media/sample.mp4", name: "flower.mp4" };

/** `onasset` is called with the uploaded video and its file; `onlearn` opens the first project, which explains keys. */
export function createWelcome(onasset: (asset: Asset, file: File) => void, onlearn: () => Promise<void>): View {
  const fault = h("div", { class: "welcome-fault" });
  const inside = h("div", { class: "drop-inside" });
  const zone = createDropzone(
    { accept: ACCEPT.video, label: "Choose a video", onfile: take, class: "drop-large" },
    inside,
  );
  const stopping = new AbortController();
  invite();

  function invite(): void {
    const pick = h("span", { class: "button primary", "aria-hidden": "true" }, "Choose a video");
    const formats = h("span", { class: "drop-hint" }, "A video, an image, or a zip of numbered frames");
    fill(
      inside,
      h("span", { class: "drop-title" }, "Drop a video here"),
      h("span", { class: "drop-or" }, "or"),
      pick,
      formats,
    );
  }

  async function take(file: File): Promise<void> {
    if (zone.classList.contains("busy")) return;
    fill(fault);
    zone.classList.add("busy");
    const onProgress = showProgress(inside, file);
    try {
      onasset(await upload(file, { onProgress, signal: stopping.signal }), file);
    } catch (error) {
      if (!isAbort(error)) fill(fault, problemBlock(asProblem(error)));
      invite();
    }
    zone.classList.remove("busy");
  }

  async function trySample(): Promise<void> {
    try {
      const answer = await request(SAMPLE.path);
      await take(new File([await answer.blob()], SAMPLE.name, { type: "video/mp4" }));
    } catch (error) {
      fill(fault, problemBlock(asProblem(error)));
    }
  }

  const picture = h("img", { src: under("/static/img/sample.jpg"), alt: "", width: 100, height: 72 });
  const words = h("span", {}, "No clip at hand?", h("strong", {}, "Try the sample"));
  const sample = h("button", { type: "button", class: "sample", onclick: trySample }, picture, words);
  const learn = h(
    "button",
    { type: "button", class: "sample learn", onclick: startLesson },
    icon("brush"),
    h("span", {}, "New here?", h("strong", {}, "Learn painted keys in two minutes")),
  );

  async function startLesson(): Promise<void> {
    learn.disabled = true;
    await onlearn().catch((error) => fill(fault, problemBlock(asProblem(error))));
    learn.disabled = false;
  }

  const lede =
    "Impasto turns video into cartoons and paintings that stay steady from frame to frame: no shimmer, no crawling lines.";
  const text = h(
    "div",
    { class: "welcome-text" },
    h("h1", {}, "Video in, ", h("em", {}, "painting"), " out."),
    h("p", { class: "lede" }, lede),
    h("div", { class: "starts" }, sample, learn),
    h("p", { class: "guide-link" }, h("a", { href: under("/docs/shot") }, "Guide: paint a shot in ten minutes")),
  );
  const element = h("section", { class: "welcome" }, text, h("div", { class: "welcome-drop" }, zone, fault));
  acceptDrops(element, take);
  return { element, close: () => stopping.abort() };
}

/** Show the upload inside the drop zone; returns what to call with the fraction sent. */
function showProgress(inside: HTMLElement, file: File): (fraction: number) => void {
  const bar = h("progress", { max: 1, value: 0, "aria-label": "Upload" });
  const text = h("span", { class: "drop-hint", role: "status" }, "Starting…");
  fill(inside, h("span", { class: "drop-title drop-name" }, file.name), bar, text);
  return (fraction) => {
    bar.value = fraction;
    text.textContent = fraction < 1 ? `${percent(fraction)} of ${bytes(file.size)}` : "Reading the video…";
  };
}

/** The studio before there is a video: drop one, pick one, or try the sample. */

import { request } from "./api.js";
import { ACCEPT, acceptDrops, createDropzone } from "./dropzone.js";
import { fill, h } from "./dom.js";
import { bytes, percent } from "./format.js";
import { problemBlock } from "./notices.js";
import { upload } from "./upload.js";

const SAMPLE = { path: "/static/media/sample.mp4", name: "flower.mp4" };

/** @param {{onasset(asset, file)}} told of the uploaded video. @returns {{element, close()}} */
export function createWelcome({ onasset }) {
  const fault = h("div", { class: "welcome-fault" });
  const inside = h("div", { class: "drop-inside" });
  const zone = createDropzone({ accept: ACCEPT.video, label: "Choose a video", onfile: take, class: "drop-large" }, inside);
  const stopping = new AbortController();
  invite();

  function invite() {
    const pick = h("span", { class: "button primary", "aria-hidden": "true" }, "Choose a video");
    fill(inside, h("span", { class: "drop-title" }, "Drop a video here"), h("span", { class: "drop-or" }, "or"), pick, h("span", { class: "drop-hint" }, "MP4, WebM, MOV, MKV, AVI, GIF, or a zip of numbered frames"));
  }

  async function take(file) {
    if (zone.classList.contains("busy")) return;
    fill(fault);
    zone.classList.add("busy");
    const bar = fillProgress(inside, file);
    try {
      onasset(await upload(file, { onProgress: bar, signal: stopping.signal }), file);
    } catch (problem) {
      if (problem.name !== "AbortError") fill(fault, problemBlock(problem));
      invite();
    }
    zone.classList.remove("busy");
  }

  async function trySample() {
    const answer = await request(SAMPLE.path).catch((problem) => fill(fault, problemBlock(problem)));
    if (answer) take(new File([await answer.blob()], SAMPLE.name, { type: "video/mp4" }));
  }

  const picture = h("img", { src: "/static/img/sample.jpg", alt: "", width: 100, height: 72 });
  const sample = h("button", { type: "button", class: "sample", onclick: trySample }, picture, h("span", {}, "No clip at hand?", h("strong", {}, "Try the sample")));
  const text = h("div", { class: "welcome-text" }, h("h1", {}, "Video in, ", h("em", {}, "painting"), " out."), h("p", { class: "lede" }, "Impasto turns footage into cartoons and paintings that hold still where they should: no shimmer, no crawling lines."), sample);
  const element = h("section", { class: "welcome" }, text, h("div", { class: "welcome-drop" }, zone, fault));
  acceptDrops(element, take);
  return { element, close: () => stopping.abort() };
}

/** Show the upload inside the drop; returns what to call with the fraction sent. */
function fillProgress(inside, file) {
  const bar = h("progress", { max: 1, value: 0, "aria-label": "Upload" });
  const text = h("span", { class: "drop-hint", role: "status" }, "Starting…");
  fill(inside, h("span", { class: "drop-title drop-name" }, file.name), bar, text);
  return (fraction) => {
    bar.value = fraction;
    text.textContent = fraction < 1 ? `${percent(fraction)} of ${bytes(file.size)}` : "Looking at it…";
  };
}

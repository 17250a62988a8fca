/** What stands on the easel while a job runs: its newest finished frame, and before that the sketch: the original. */

import * as api from "./api.js";
import { h, icon } from "./dom.js";
import { createStills } from "./stills.js";

const PREVIEW_MS = 1000;

/** @returns {{element, update(job), close()}} */
export function createEasel(id) {
  const picture = h("img", { class: "picture", alt: "The newest finished frame", hidden: true });
  const sketch = h("video", { class: "picture sketch", muted: true, playsinline: "", preload: "auto", tabindex: "-1", "aria-hidden": "true" });
  const blank = h("div", { class: "easel-blank" }, icon("brush"), h("p", {}, "The first frames appear here."));
  const frame = h("div", { class: "frame" }, sketch, blank, picture);
  let busy = false;
  let last = 0;
  let sketched = false;
  let still = null;

  sketch.addEventListener("loadedmetadata", () => shape(sketch.videoWidth / sketch.videoHeight));
  const shape = (ratio) => frame.style.setProperty("--ratio", String(ratio || 16 / 9));

  async function lay(assetId) {
    sketched = true;
    const url = await api.mediaUrl(api.paths.content(assetId)).catch(() => "");
    if (url && picture.hidden) sketch.src = url;
    sketch.addEventListener("error", () => sketch.hasAttribute("src") && trace(assetId), { once: true });
  }

  /** The browser cannot play the original: a frame of it, decoded by the service. */
  function trace(assetId) {
    still = createStills(assetId, { class: "picture sketch", alt: "", "aria-hidden": "true" });
    still.element.addEventListener("load", () => picture.hidden && shape(still.element.naturalWidth / still.element.naturalHeight));
    sketch.replaceWith(still.element);
    if (picture.hidden) still.show(0);
  }

  async function update(job) {
    if (!sketched) lay(job.request.inputs.video);
    const name = ["preview", "poster"].find((file) => job.results.includes(file));
    if (!name || busy || Date.now() - last < PREVIEW_MS) return;
    busy = true;
    await api.objectUrl(api.paths.file(id, name)).then(show, () => {});
    last = Date.now();
    busy = false;
  }

  async function show(url) {
    const old = picture.src;
    picture.src = url;
    await picture.decode().catch(() => {});
    shape(picture.naturalWidth / picture.naturalHeight);
    picture.hidden = false;
    sketch.hidden = blank.hidden = true;
    if (still) still.element.hidden = true;
    if (old) URL.revokeObjectURL(old);
  }

  function close() {
    still?.close();
    for (const url of [picture.src, sketch.src]) if (url.startsWith("blob:")) URL.revokeObjectURL(url);
    sketch.removeAttribute("src");
    sketch.load();
  }

  return { element: h("div", { class: "easel" }, frame), update, close };
}

/** The stage of the studio: one frame, original and painted, that follows the parameters as they change. */

import * as api from "./api.js";
import { h, iconButton } from "./dom.js";
import { clock } from "./format.js";
import { createOriginal } from "./original.js";
import { createWipe } from "./wipe.js";

const DEBOUNCE_MS = 220;
const MAX_SIDE_PX = 720;
/** The service makes few previews at once: when it is busy, ask again. */
const BUSY_TRIES = 10;
const BUSY_MS = 1200;

/**
 * @param {{onframe(frame), onproblem(problem), onpainted()}} told of what happens
 * @returns {{element, show(asset, localUrl, frame), paint(request), frame: number, close()}}
 */
export function createPreview({ onframe, onproblem, onpainted }) {
  const original = createOriginal();
  const painted = h("img", { class: "picture", alt: "The frame, painted", decoding: "async" });
  const wipe = createWipe({ before: original.element, after: painted });
  const status = h("p", { class: "stage-status" });
  const frame = h("div", { class: "frame", "aria-busy": "false" }, wipe.element, h("div", { class: "stage-busy" }), status);
  const scrubber = createScrubber(moved);
  const element = h("section", { class: "stage", "aria-label": "Preview of one frame" }, frame, scrubber.element);
  const painter = createPainter({ began, came, failed });
  let wanted = null;

  original.onfail(() => element.classList.add("no-original"));

  function began() {
    frame.setAttribute("aria-busy", "true");
    status.textContent = painted.src ? "" : "Painting this frame…";
  }

  function came(url) {
    if (painted.src) URL.revokeObjectURL(painted.src);
    painted.src = url;
    element.classList.add("painted");
    settled("");
    onpainted();
  }

  function failed(problem) {
    settled(painted.src ? "" : "No preview");
    onproblem(problem);
  }

  function settled(text) {
    frame.setAttribute("aria-busy", "false");
    status.textContent = text;
  }

  function moved(index) {
    original.seek(index);
    if (wanted) painter.paint({ ...wanted, frame: index });
    onframe(index);
  }

  return {
    element,
    wipe,
    get frame() {
      return scrubber.value;
    },
    /** Show frame `index` of a video asset; `localUrl` is the file just chosen, which needs no download. */
    show(asset, localUrl, index) {
      const { width = 16, height = 9, frames = 1, fps = 25 } = asset.info;
      frame.style.setProperty("--ratio", String(width / height));
      scrubber.range(frames, fps, index);
      original.load(asset, localUrl, scrubber.value);
    },
    paint(request) {
      wanted = { ...request, max_side_px: MAX_SIDE_PX };
      painter.paint({ ...wanted, frame: scrubber.value });
    },
    close() {
      painter.stop();
      original.close();
      if (painted.src) URL.revokeObjectURL(painted.src);
    },
  };
}

/** Debounced requests of which only the newest counts. */
function createPainter({ began, came, failed }) {
  let timer = 0;
  let running = new AbortController();
  const stop = () => {
    clearTimeout(timer);
    running.abort();
  };
  async function send(body, tries = 0) {
    const mine = (running = new AbortController());
    try {
      const url = URL.createObjectURL(await api.preview(body, mine.signal));
      if (!mine.signal.aborted) came(url);
    } catch (problem) {
      if (mine.signal.aborted) return;
      if (problem.code === "busy" && tries < BUSY_TRIES) timer = setTimeout(send, BUSY_MS, body, tries + 1);
      else failed(problem);
    }
  }
  function paint(body) {
    stop();
    began();
    timer = setTimeout(send, DEBOUNCE_MS, body);
  }
  return { paint, stop };
}

function createScrubber(moved) {
  const track = h("input", { type: "range", min: "0", step: "1", "aria-label": "Frame to preview" });
  const label = h("output", { class: "time" });
  let rate = 25;
  const show = () => {
    track.style.setProperty("--fill", track.max > 0 ? track.value / track.max : 0);
    label.textContent = `Frame ${Number(track.value) + 1} of ${Number(track.max) + 1} · ${clock(track.value / rate)}`;
    track.setAttribute("aria-valuetext", label.textContent);
  };
  const update = () => (show(), moved(Number(track.value)));
  const step = (by) => {
    track.value = String(Number(track.value) + by);
    update();
  };
  track.addEventListener("input", update);
  const buttons = [iconButton("back", "Previous frame", () => step(-1)), iconButton("next", "Next frame", () => step(1))];
  return {
    element: h("div", { class: "scrubber" }, buttons[0], track, buttons[1], label),
    get value() {
      return Number(track.value);
    },
    range(frames, fps, index) {
      rate = fps;
      track.max = String(Math.max(0, frames - 1));
      track.value = String(index ?? Math.floor(frames / 3));
      show();
    },
  };
}

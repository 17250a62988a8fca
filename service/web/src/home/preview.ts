/** The stage of the quick page: one frame, original and painted, which follows the parameters as they change. */

import * as api from "../api/api";
import type { Asset, PreviewRequest } from "../api/schemas";
import type { View } from "../ui/dom";
import { h } from "../ui/dom";
import { clock } from "../ui/format";
import { iconButton } from "../ui/icons";
import { createWipe } from "../ui/wipe";
import { createOriginal } from "./original";

const DEBOUNCE_MS = 100;
const MAX_SIDE_PX = 720;
/** The service makes few previews at once: when it is busy, ask again. */
const BUSY_TRIES = 10;
const BUSY_MS = 1200;

export interface PreviewEvents {
  onframe(frame: number): void;
  onproblem(problem: api.Problem): void;
  onpainted(): void;
}

export interface Preview extends View {
  readonly frame: number;
  /** Show a frame of a video asset, by default one after a third; `localUrl` is the file just chosen. */
  show(asset: Asset, localUrl: string | undefined, frame: number | null): void;
  paint(request: Omit<PreviewRequest, "frame" | "max_side_px">): void;
}

export function createPreview({ onframe, onproblem, onpainted }: PreviewEvents): Preview {
  const original = createOriginal();
  const painted = h("img", { class: "picture", alt: "The frame, painted", decoding: "async" });
  const wipe = createWipe({ before: original.element, after: painted });
  const status = h("p", { class: "stage-status" });
  const frame = h(
    "div",
    { class: "frame", "aria-busy": "false" },
    wipe.element,
    h("div", { class: "stage-busy" }),
    status,
  );
  const scrubber = createScrubber(moved);
  const element = h("section", { class: "stage", "aria-label": "Preview of one frame" }, frame, scrubber.element);
  const painter = createPainter({ began, came, failed });
  let wanted: Omit<PreviewRequest, "frame"> | null = null;

  original.onfail(() => element.classList.add("no-original"));

  function began(): void {
    frame.setAttribute("aria-busy", "true");
    status.textContent = painted.src ? "" : "Painting this frame…";
  }

  function came(url: string): void {
    if (painted.src) URL.revokeObjectURL(painted.src);
    painted.src = url;
    element.classList.add("painted");
    settled("");
    onpainted();
  }

  function failed(problem: api.Problem): void {
    settled(painted.src ? "" : "No preview");
    onproblem(problem);
  }

  function settled(text: string): void {
    frame.setAttribute("aria-busy", "false");
    status.textContent = text;
  }

  function moved(index: number): void {
    original.seek(index);
    if (wanted) painter.paint({ ...wanted, frame: index });
    onframe(index);
  }

  return {
    element,
    get frame() {
      return scrubber.value;
    },
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

interface PainterEvents {
  began(): void;
  came(url: string): void;
  failed(problem: api.Problem): void;
}

/** Debounced requests of which only the newest counts. */
function createPainter({ began, came, failed }: PainterEvents) {
  let timer = 0;
  let running = new AbortController();
  const stop = () => {
    clearTimeout(timer);
    running.abort();
  };
  async function send(body: PreviewRequest, tries = 0): Promise<void> {
    const mine = new AbortController();
    running = mine;
    try {
      const url = URL.createObjectURL(await api.preview(body, mine.signal));
      if (!mine.signal.aborted) came(url);
    } catch (error) {
      if (mine.signal.aborted) return;
      const problem = api.asProblem(error);
      if (problem.code === "busy" && tries < BUSY_TRIES) timer = window.setTimeout(send, BUSY_MS, body, tries + 1);
      else failed(problem);
    }
  }
  function paint(body: PreviewRequest): void {
    stop();
    began();
    timer = window.setTimeout(send, DEBOUNCE_MS, body);
  }
  return { paint, stop };
}

function createScrubber(moved: (index: number) => void) {
  const track = h("input", { type: "range", min: "0", step: "1", "aria-label": "Frame to preview" });
  const label = h("output", { class: "time" });
  let rate = 25;
  const show = () => {
    const [at, last] = [Number(track.value), Number(track.max)];
    track.style.setProperty("--fill", String(last > 0 ? at / last : 0));
    label.textContent = `Frame ${at + 1} of ${last + 1} · ${clock(at / rate)}`;
    track.setAttribute("aria-valuetext", label.textContent);
  };
  const update = () => {
    show();
    moved(Number(track.value));
  };
  const step = (by: number) => {
    track.value = String(Number(track.value) + by);
    update();
  };
  track.addEventListener("input", update);
  const back = iconButton("back", "Previous frame", () => step(-1));
  const next = iconButton("next", "Next frame", () => step(1));
  return {
    element: h("div", { class: "scrubber" }, back, track, next, label),
    get value() {
      return Number(track.value);
    },
    range(frames: number, fps: number, index: number | null) {
      rate = fps;
      track.max = String(Math.max(0, frames - 1));
      track.value = String(index ?? Math.floor(frames / 3));
      show();
    },
  };
}

/** The picture of the live page: the original and the painting, wiped, side by side, or the painting alone. */

import { h } from "../ui/dom";
import { createWipe } from "../ui/wipe";
import type { Size } from "./types";

export type LiveView = "painted" | "wipe" | "beside";

export interface Screen {
  element: HTMLElement;
  /** The painting, whose stream is recorded. */
  canvas: HTMLCanvasElement;
  resize(size: Size): void;
  /** Show an answer, and the frame that it was made from. */
  paint(picture: CanvasImageSource, original: CanvasImageSource): void;
  /** Show the source itself, while there is no answer yet. */
  preview(picture: CanvasImageSource, size: Size): void;
  view: LiveView;
  readonly painted: boolean;
  mirrored: boolean;
  clear(): void;
}

/** `onresize` is called before the painting gets another size. */
export function createScreen(onresize: () => void): Screen {
  const before = createSheet("The original");
  const after = createSheet("The painting");
  const wipe = createWipe({ before: before.canvas, after: after.canvas });
  const element = h("div", { class: "frame live-frame" }, wipe.element);
  let view: LiveView = "wipe";
  let painted = false;

  function resize({ width, height }: Size): void {
    if (after.canvas.width === width && after.canvas.height === height) return;
    onresize();
    element.style.setProperty("--ratio", String(width / height));
    for (const each of [before, after]) each.resize(width, height);
  }

  const screen: Screen = {
    element,
    canvas: after.canvas,
    resize,
    paint(picture, original) {
      after.draw(picture);
      if (view !== "painted") before.draw(original);
      if (!painted) element.classList.add("painted");
      painted = true;
    },
    preview(picture, size) {
      if (painted) return;
      resize(size);
      before.draw(picture);
    },
    get view() {
      return view;
    },
    set view(name) {
      view = name;
      element.dataset.view = name;
      wipe.alone(name === "painted" ? "after" : null);
    },
    get painted() {
      return painted;
    },
    get mirrored() {
      return element.classList.contains("mirrored");
    },
    set mirrored(on) {
      element.classList.toggle("mirrored", on);
    },
    clear() {
      painted = false;
      element.classList.remove("painted");
      for (const each of [before, after]) each.clear();
    },
  };
  screen.view = "wipe";
  return screen;
}

function createSheet(label: string) {
  const canvas = h("canvas", { class: "picture", role: "img", "aria-label": label, width: 16, height: 9 });
  const context = canvas.getContext("2d", { alpha: false });
  return {
    canvas,
    draw(picture: CanvasImageSource) {
      if (!context) return;
      context.imageSmoothingQuality = "high"; // the service may paint at a smaller size; resizing a canvas resets this
      context.drawImage(picture, 0, 0, canvas.width, canvas.height);
    },
    /** Keeps the shown picture, so that it does not flash when a phone is rotated. */
    resize(width: number, height: number) {
      const shown = Object.assign(document.createElement("canvas"), { width, height });
      shown.getContext("2d")?.drawImage(canvas, 0, 0, width, height);
      Object.assign(canvas, { width, height });
      context?.drawImage(shown, 0, 0);
    },
    clear: () => context?.clearRect(0, 0, canvas.width, canvas.height),
  };
}

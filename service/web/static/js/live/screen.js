/** What people look at: the original and the painting, wiped, side by side, or the painting alone. */

import { h } from "../dom.js";
import { createWipe } from "../wipe.js";

/**
 * @param {function()} onresize called before the painting gets another size
 * @returns {{element, canvas, paint(picture, original), preview(picture, size), resize(size), view: string, painted: boolean, mirrored: boolean, clear()}}
 */
export function createScreen(onresize) {
  const before = sheet("The original");
  const after = sheet("The painting");
  const wipe = createWipe({ before: before.canvas, after: after.canvas });
  const element = h("div", { class: "frame live-frame" }, wipe.element);
  let view = "";
  let painted = false;

  function resize({ width, height }) {
    if (after.canvas.width === width && after.canvas.height === height) return;
    onresize();
    element.style.setProperty("--ratio", String(width / height));
    for (const each of [before, after]) each.resize(width, height);
  }

  const screen = {
    element,
    /** The painting; its stream is what is recorded. */
    canvas: after.canvas,
    resize,
    /** An answer, and the frame that it was made from. */
    paint(picture, original) {
      after.draw(picture);
      if (view !== "painted") before.draw(original);
      if (!painted) element.classList.add("painted");
      painted = true;
    },
    /** The source itself, while there is no answer yet. */
    preview(picture, size) {
      if (painted) return;
      resize(size);
      before.draw(picture);
    },
    /** "painted", "wipe" or "beside". */
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

function sheet(label) {
  const canvas = h("canvas", { class: "picture", role: "img", "aria-label": label, width: 16, height: 9 });
  const context = canvas.getContext("2d", { alpha: false });
  return {
    canvas,
    draw(picture) {
      context.imageSmoothingQuality = "high"; // the service may paint at a smaller size; resizing a canvas forgets this
      context.drawImage(picture, 0, 0, canvas.width, canvas.height);
    },
    /** Keeps what it shows: nothing flashes when a phone is turned. */
    resize(width, height) {
      const shown = Object.assign(document.createElement("canvas"), { width, height });
      shown.getContext("2d").drawImage(canvas, 0, 0, width, height);
      Object.assign(canvas, { width, height });
      context.drawImage(shown, 0, 0);
    },
    clear: () => context.clearRect(0, 0, canvas.width, canvas.height),
  };
}

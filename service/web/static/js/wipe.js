/** Two pictures one over the other, and a handle that wipes between them: by pointer, touch or keyboard. */

import { h } from "./dom.js";

const KEYS = { ArrowLeft: -2, ArrowDown: -2, ArrowRight: 2, ArrowUp: 2, PageDown: -10, PageUp: 10, Home: -100, End: 100 };

/**
 * @param {{before: Element, after: Element, labels?: [string, string]}} layers `before` shows left of the handle
 * @returns {{element, split: number, alone(what)}} split in percent of the width; alone("after"|"before"|null)
 */
export function createWipe({ before, after, labels = ["Original", "Painted"] }) {
  const handle = h("div", { class: "wipe-handle", role: "slider", tabindex: "0", "aria-label": "Compare original and painted", "aria-valuemin": "0", "aria-valuemax": "100" }, h("span", { class: "wipe-grip" }));
  const tags = labels.map((text, i) => h("span", { class: `wipe-tag wipe-tag-${i}`, "aria-hidden": "true" }, text));
  const element = h("div", { class: "wipe" }, layer(before, "before"), layer(after, "after"), tags, handle);
  const wipe = {
    element,
    get split() {
      return Number(handle.getAttribute("aria-valuenow"));
    },
    set split(percent) {
      const value = Math.min(100, Math.max(0, percent));
      element.style.setProperty("--split", `${value}%`);
      element.classList.toggle("at-start", value < 14);
      element.classList.toggle("at-end", value > 86);
      handle.setAttribute("aria-valuenow", String(Math.round(value)));
      handle.setAttribute("aria-valuetext", `${Math.round(value)} % original`);
    },
    /** Show one layer only, or both with the handle. */
    alone(what) {
      element.dataset.alone = what ?? "";
      handle.tabIndex = what ? -1 : 0;
    },
  };
  wipe.split = 50;
  wipe.alone(null);
  listen(wipe, handle);
  return wipe;
}

const layer = (content, name) => h("div", { class: `wipe-layer wipe-${name}` }, content);

function listen(wipe, handle) {
  const { element } = wipe;
  const follow = (event) => {
    const box = element.getBoundingClientRect();
    wipe.split = (100 * (event.clientX - box.left)) / box.width;
  };
  element.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || element.dataset.alone) return;
    element.setPointerCapture(event.pointerId);
    element.classList.add("dragging");
    handle.focus({ preventScroll: true });
    event.preventDefault();
    follow(event);
  });
  element.addEventListener("pointermove", (event) => element.hasPointerCapture(event.pointerId) && follow(event));
  element.addEventListener("lostpointercapture", () => element.classList.remove("dragging"));
  handle.addEventListener("keydown", (event) => {
    if (!(event.key in KEYS)) return;
    event.preventDefault();
    wipe.split += KEYS[event.key] * (event.shiftKey ? 5 : 1);
  });
}

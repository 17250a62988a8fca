/** Two pictures one over the other, and a handle that wipes between them: by pointer, touch or keyboard. */

import { h } from "./dom";

const STEPS: Record<string, number> = {
  ArrowLeft: -2,
  ArrowDown: -2,
  ArrowRight: 2,
  ArrowUp: 2,
  PageDown: -10,
  PageUp: 10,
  Home: -100,
  End: 100,
};

export type Side = "before" | "after";

export interface Wipe {
  element: HTMLElement;
  /** Percent of the width that shows `before`. */
  split: number;
  /** Show one layer only, or both with the handle. */
  alone(what: Side | null): void;
}

/** `before` shows left of the handle. */
export function createWipe(layers: Record<Side, Element>, labels: [string, string] = ["Original", "Painted"]): Wipe {
  const handle = h(
    "div",
    {
      class: "wipe-handle",
      role: "slider",
      tabindex: "0",
      "aria-label": `Compare ${labels[0].toLowerCase()} and ${labels[1].toLowerCase()}`,
      "aria-valuemin": "0",
      "aria-valuemax": "100",
    },
    h("span", { class: "wipe-grip" }),
  );
  const tags = labels.map((text, i) => h("span", { class: `wipe-tag wipe-tag-${i}`, "aria-hidden": "true" }, text));
  const element = h(
    "div",
    { class: "wipe" },
    layer(layers.before, "before"),
    layer(layers.after, "after"),
    tags,
    handle,
  );
  const wipe: Wipe = {
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
      handle.setAttribute("aria-valuetext", `${Math.round(value)} % ${labels[0].toLowerCase()}`);
    },
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

const layer = (content: Element, name: Side): HTMLElement => h("div", { class: `wipe-layer wipe-${name}` }, content);

function listen(wipe: Wipe, handle: HTMLElement): void {
  const { element } = wipe;
  const follow = (event: PointerEvent) => {
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
    const step = STEPS[event.key];
    if (step === undefined) return;
    event.preventDefault();
    wipe.split += step * (event.shiftKey ? 5 : 1);
  });
}

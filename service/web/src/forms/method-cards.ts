/** Choosing a method by card and a ready set of parameters by chip. */

import { mediaUrl } from "../shared/api";
import { type Child, h, unique } from "../shared/dom";
import type { Example, Json, Method, Params } from "../shared/types";

/** The picture that the service offers of a method. */
function picture(method: Method): Child {
  if (!method.thumbnail) return false;
  const element = h("img", { class: "card-picture", alt: "" });
  mediaUrl(method.thumbnail).then(
    (url) => {
      element.src = url;
    },
    () => element.remove(),
  );
  return element;
}

/** Cards of all methods; `onchoose(name)` when another is chosen. */
export function createMethodCards(methods: Method[], chosen: string, onchoose: (name: string) => void): HTMLElement {
  const name = unique("method");
  const card = (method: Method) =>
    h(
      "label",
      { class: "card" },
      h("input", {
        type: "radio",
        name,
        value: method.name,
        checked: method.name === chosen,
        onchange: () => onchoose(method.name),
      }),
      picture(method),
      h("span", { class: "card-text" }, h("strong", {}, method.title), h("span", {}, method.summary)),
    );
  return h("div", { class: "cards", role: "radiogroup", "aria-label": "Method" }, methods.map(card));
}

export interface Presets {
  element: HTMLElement;
  /** The examples, the defaults first. */
  all: readonly Example[];
  /** Mark the example whose parameters these are, if any. */
  match(params: Params): void;
  /** Pictures will come: keep room for them, in their ratio of width to height. */
  expectPictures(ratio: number): void;
  /** Show a picture on the example of this name. */
  picture(name: string, picture: Blob): void;
}

/** One transparent pixel: an image without an address takes no room. */
const NOTHING = "data:image/svg+xml,%3Csvg xmlns='http://www.w3.org/2000/svg'/%3E";

/** Chips of a method's examples. `onchoose(params)` when one is pressed. */
export function createPresets(examples: Example[], onchoose: (params: Params) => void): Presets {
  const standard: Example = { name: "default", title: "Default", params: {} };
  const all = [standard, ...examples.filter((example) => Object.keys(example.params).length)];
  const buttons = all.map((example) =>
    h(
      "button",
      { type: "button", class: "chip-button", "aria-pressed": "false", onclick: () => onchoose(example.params) },
      h("img", { class: "card-blank", alt: "", src: NOTHING }),
      h("span", {}, example.title),
    ),
  );
  const key = (params: Record<string, Json>) => JSON.stringify(Object.entries(params).sort());
  const element = h("div", { class: "presets", role: "group", "aria-label": "Presets" }, buttons);
  return {
    element,
    all,
    expectPictures(ratio) {
      element.style.setProperty("--ratio", String(ratio));
      element.classList.add("pictured");
    },
    picture(name, picture) {
      const shown = buttons[all.findIndex((example) => example.name === name)]?.querySelector("img");
      if (!shown) return;
      URL.revokeObjectURL(shown.src);
      shown.src = URL.createObjectURL(picture);
    },
    match(params) {
      buttons.forEach((button, i) => {
        button.setAttribute("aria-pressed", String(key(all[i]?.params ?? {}) === key(params)));
      });
    },
  };
}

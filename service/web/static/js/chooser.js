/** Choosing a method by card and a ready set of parameters by chip. */

import { mediaUrl } from "./api.js";
import { h, unique } from "./dom.js";

/** The picture the service offers of a method. */
function picture(method) {
  if (!method.thumbnail) return false;
  const element = h("img", { class: "card-picture", alt: "" });
  mediaUrl(method.thumbnail).then((url) => (element.src = url), () => element.remove());
  return element;
}

/** Cards of all methods; `onchoose(name)` when another is chosen. */
export function createMethodCards(methods, chosen, onchoose) {
  const name = unique("method");
  const card = (method) =>
    h(
      "label",
      { class: "card" },
      h("input", { type: "radio", name, value: method.name, checked: method.name === chosen, onchange: () => onchoose(method.name) }),
      picture(method),
      h("span", { class: "card-text" }, h("strong", {}, method.title), h("span", {}, method.summary)),
    );
  return h("div", { class: "cards", role: "radiogroup", "aria-label": "Method" }, methods.map(card));
}

/**
 * Chips of a method's examples. `onchoose(params)` when one is pressed.
 * @returns {{element, match(params)}} match: mark the example that the parameters now are, if any
 */
export function createPresets(examples, onchoose) {
  const all = [{ name: "default", title: "Default", params: {} }, ...examples.filter((e) => Object.keys(e.params).length)];
  const buttons = all.map((example) => h("button", { type: "button", class: "chip-button", "aria-pressed": "false", onclick: () => onchoose(example.params) }, example.title));
  const key = (params) => JSON.stringify(Object.entries(params).sort());
  return {
    element: h("div", { class: "presets", role: "group", "aria-label": "Presets" }, buttons),
    match: (params) => buttons.forEach((button, i) => button.setAttribute("aria-pressed", String(key(all[i].params) === key(params)))),
  };
}

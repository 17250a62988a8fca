/** Short messages at the edge of the page, for what belongs to no field. */

import { h, icon, iconButton } from "./dom.js";

const host = () => document.getElementById("notices");

/** Show a Problem (or any Error) until it is closed, or for twelve seconds. */
export function notify(error, title = error.title) {
  if (error.name === "AbortError") return;
  const text = h("div", {}, title && h("strong", {}, title), h("p", {}, error.message), error.remedy && h("p", { class: "remedy" }, error.remedy));
  const close = () => notice.remove();
  const notice = h("div", { class: "notice" }, icon("alert"), text, iconButton("close", "Close", close));
  host().append(notice);
  setTimeout(close, 12_000);
}

/** A Problem as a block in the page, with what can be done about it. */
export function problemBlock(error, ...actions) {
  const text = h("div", {}, h("strong", {}, error.title || "That did not work"), h("p", {}, error.message), error.remedy && h("p", { class: "remedy" }, error.remedy), actions.length > 0 && h("div", { class: "actions" }, actions));
  return h("div", { class: "problem", role: "alert" }, icon("alert"), text);
}

/** Say something to assistive technology only. */
export function announce(text) {
  const line = h("p", { class: "visually-hidden" }, text);
  host().append(line);
  setTimeout(() => line.remove(), 4000);
}

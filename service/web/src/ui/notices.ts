/** Short messages at the edge of the page, for what belongs to no field. */

import { asProblem, isAbort } from "../api/api";
import { byId, type Child, h } from "./dom";
import { icon, iconButton } from "./icons";

const SHOWN_MS = 12_000;

/** What a message shows; a Problem is one. */
export interface Message {
  title?: string;
  message: string;
  remedy?: string;
}

/** Show a Problem, or any error, until it is closed or twelve seconds have passed. */
export function notify(error: unknown): void {
  if (!isAbort(error)) notifyOf(asProblem(error));
}

/** Show a message in the same place. */
export function notifyOf({ title, message, remedy }: Message): void {
  const text = h(
    "div",
    {},
    title && h("strong", {}, title),
    h("p", {}, message),
    remedy && h("p", { class: "remedy" }, remedy),
  );
  const close = () => notice.remove();
  const notice = h("div", { class: "notice" }, icon("alert"), text, iconButton("close", "Close", close));
  byId("notices").append(notice);
  setTimeout(close, SHOWN_MS);
}

/** A message with an action, for example "Deleted" with "Undo"; `timeout()` is called when it leaves without the action. */
export function offerUndo(message: string, undo: () => void, timeout: () => void, ms = 6000): void {
  const leave = (act: () => void) => () => {
    if (!notice.isConnected) return;
    notice.remove();
    clearTimeout(timer);
    act();
  };
  const button = h("button", { type: "button", class: "button small", onclick: leave(undo) }, "Undo");
  const notice = h(
    "div",
    { class: "notice plain" },
    h("div", {}, h("p", {}, message)),
    button,
    iconButton("close", "Close", leave(timeout)),
  );
  byId("notices").append(notice);
  const timer = setTimeout(leave(timeout), ms);
  window.addEventListener("pagehide", leave(timeout), { once: true });
}

/** A Problem as a block in the page, with the actions that may help. */
export function problemBlock(error: Message, ...actions: Child[]): HTMLElement {
  const shown = actions.flat().filter(Boolean);
  const text = h(
    "div",
    {},
    h("strong", {}, error.title || "That did not work"),
    h("p", {}, error.message),
    error.remedy && h("p", { class: "remedy" }, error.remedy),
    shown.length > 0 && h("div", { class: "actions" }, shown),
  );
  return h("div", { class: "problem", role: "alert" }, icon("alert"), text);
}

/** A block with warnings that the user should know although the work continues; null without warnings. */
export function warningBlock(title: string, messages: string[]): HTMLElement | null {
  if (!messages.length) return null;
  const text = h(
    "div",
    {},
    h("strong", {}, title),
    messages.map((message) => h("p", {}, message)),
  );
  return h("div", { class: "problem warning", role: "status" }, icon("alert"), text);
}

/** Speak to assistive technology only. */
export function announce(text: string): void {
  const line = h("p", { class: "visually-hidden" }, text);
  byId("notices").append(line);
  setTimeout(() => line.remove(), 4000);
}

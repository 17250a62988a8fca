/** What every page does at its start. */

import { onKeyNeeded } from "../api/api";
import { byId } from "./dom";
import { askKey } from "./key-dialog";

/** Prepare the key dialog, the skip link and dropped files; returns the element that the page fills. */
export function preparePage(): HTMLElement {
  const main = byId("main");
  onKeyNeeded(askKey);
  byId("skip").addEventListener("click", () => main.focus());
  for (const kind of ["dragover", "drop"]) window.addEventListener(kind, (event) => event.preventDefault());
  return main;
}

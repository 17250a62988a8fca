/** A place to drop one file on, or pick it; works by keyboard since it is a label over a file input. */

import { h } from "./dom.js";

/** Call `onfile(file)` for the first file dropped on `element`. */
export function acceptDrops(element, onfile) {
  let depth = 0;
  const mark = (step) => {
    depth = step === 0 ? 0 : Math.max(0, depth + step);
    element.classList.toggle("over", depth > 0);
  };
  element.addEventListener("dragenter", (event) => carriesFile(event) && (event.preventDefault(), mark(1)));
  element.addEventListener("dragleave", (event) => carriesFile(event) && mark(-1));
  element.addEventListener("dragover", (event) => carriesFile(event) && event.preventDefault());
  element.addEventListener("drop", (event) => {
    if (!event.dataTransfer.files.length) return;
    event.preventDefault();
    event.stopPropagation();
    mark(0);
    onfile(event.dataTransfer.files[0]);
  });
}

const carriesFile = (event) => event.dataTransfer?.types.includes("Files");

/**
 * @param {{accept: string, label: string, onfile: Function, class?: string}} options
 * @param {...Node} content shown inside
 */
export function createDropzone({ accept, label, onfile, class: name = "" }, ...content) {
  const input = h("input", { type: "file", accept, "aria-label": label, class: "drop-input" });
  input.addEventListener("change", () => {
    if (input.files[0]) onfile(input.files[0]);
    input.value = "";
  });
  const element = h("label", { class: `drop ${name}` }, input, ...content);
  acceptDrops(element, onfile);
  return element;
}

/** What a file picker should offer for an input of a method, by its kind. */
export const ACCEPT = {
  video: "video/*,.mkv,.avi,.mov,.gif,.webm,.mp4,.zip",
  image: "image/*",
  "image-or-video": "image/*,video/*,.mkv",
  images: ".zip,application/zip",
  json: ".json,application/json",
};

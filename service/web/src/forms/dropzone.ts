/** A place to drop one file on, or pick it; works by keyboard, since it is a label over a file input. */

import { type Child, h } from "../shared/dom";
import { accept } from "../shared/formats";
import type { InputKind } from "../shared/types";

/** Call `onfile(file)` for the first file dropped on `element`. */
export function acceptDrops(element: HTMLElement, onfile: (file: File) => void): void {
  let depth = 0;
  const mark = (step: number) => {
    depth = step === 0 ? 0 : Math.max(0, depth + step);
    element.classList.toggle("over", depth > 0);
  };
  element.addEventListener("dragenter", (event) => {
    if (!carriesFile(event)) return;
    event.preventDefault();
    mark(1);
  });
  element.addEventListener("dragleave", (event) => carriesFile(event) && mark(-1));
  element.addEventListener("dragover", (event) => carriesFile(event) && event.preventDefault());
  element.addEventListener("drop", (event) => {
    const file = event.dataTransfer?.files[0];
    if (!file) return;
    event.preventDefault();
    event.stopPropagation();
    mark(0);
    onfile(file);
  });
}

const carriesFile = (event: DragEvent): boolean => event.dataTransfer?.types.includes("Files") ?? false;

export interface DropzoneOptions {
  /** As the attribute of a file input. */
  accept: string;
  label: string;
  onfile(file: File): void;
  class?: string;
}

export function createDropzone(options: DropzoneOptions, ...content: Child[]): HTMLLabelElement {
  const { accept, label, onfile, class: name = "" } = options;
  const input = h("input", { type: "file", accept, "aria-label": label, class: "drop-input" });
  input.addEventListener("change", () => {
    const file = input.files?.[0];
    if (file) onfile(file);
    input.value = "";
  });
  const element = h("label", { class: `drop ${name}` }, input, ...content);
  acceptDrops(element, onfile);
  return element;
}

/** File types that a file picker offers for an input of a method, by its kind. */
export const ACCEPT: Record<InputKind, string> = {
  video: accept.video,
  image: accept.image,
  "image-or-video": "image/*,video/*,.mkv",
  images: ".zip,application/zip",
  json: ".json,application/json",
};

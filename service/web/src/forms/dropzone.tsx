/** A place to drop one file on, or pick it; works by keyboard, since it is a label over a file input. */

import type { ComponentChildren } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { accept } from "../api/formats";
import type { InputSpec } from "../api/schemas";

/** Call `onfile(file)` for the first file dropped on `element`, until the returned function is called. */
function acceptDrops(element: HTMLElement, onfile: (file: File) => void): () => void {
  const controller = new AbortController();
  const on = (name: "dragenter" | "dragleave" | "dragover" | "drop", act: (event: DragEvent) => void) =>
    element.addEventListener(name, act, controller);
  let depth = 0;
  const mark = (step: number) => {
    depth = step === 0 ? 0 : Math.max(0, depth + step);
    element.classList.toggle("over", depth > 0);
  };
  on("dragenter", (event) => {
    if (!carriesFile(event)) return;
    event.preventDefault();
    mark(1);
  });
  on("dragleave", (event) => carriesFile(event) && mark(-1));
  on("dragover", (event) => carriesFile(event) && event.preventDefault());
  on("drop", (event) => {
    const file = event.dataTransfer?.files[0];
    if (!file) return;
    event.preventDefault();
    event.stopPropagation();
    mark(0);
    onfile(file);
  });
  return () => controller.abort();
}

const carriesFile = (event: DragEvent): boolean => event.dataTransfer?.types.includes("Files") ?? false;

/** A ref for an element that accepts dropped files. */
export function useDrops<Target extends HTMLElement>(onfile: (file: File) => void) {
  const element = useRef<Target>(null);
  const latest = useRef(onfile);
  latest.current = onfile;
  useEffect(() => (element.current ? acceptDrops(element.current, (file) => latest.current(file)) : undefined), []);
  return element;
}

export interface DropzoneProps {
  /** As the attribute of a file input. */
  accept: string;
  label: string;
  onfile(file: File): void;
  class?: string;
  hidden?: boolean;
  children: ComponentChildren;
}

export function Dropzone({ accept, label, onfile, class: name = "", hidden = false, children }: DropzoneProps) {
  return (
    <label class={`drop ${name}`} hidden={hidden} ref={useDrops<HTMLLabelElement>(onfile)}>
      <input
        type="file"
        accept={accept}
        aria-label={label}
        class="drop-input"
        onChange={({ currentTarget: input }) => {
          const file = input.files?.[0];
          if (file) onfile(file);
          input.value = "";
        }}
      />
      {children}
    </label>
  );
}

/** File types that a file picker offers for an input of a method, by its kind. */
export const ACCEPT: Record<InputSpec["kind"], string> = {
  video: accept.video,
  image: accept.image,
  "image-or-video": "image/*,video/*,.mkv",
  images: ".zip,application/zip",
  json: ".json,application/json",
};

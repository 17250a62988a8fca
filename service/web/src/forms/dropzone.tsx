/** A place to drop files on, or pick them; works by keyboard, since it is a label over a file input. */

import type { ComponentChildren } from "preact";
import { useEffect, useRef } from "preact/hooks";
import { accept } from "../api/formats";
import type { InputSpec } from "../api/schemas";

/** Call `onfiles(files)` when files are dropped on `element`, until the returned function is called. */
function acceptDrops(element: HTMLElement, onfiles: (files: File[]) => void): () => void {
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
    const files = [...(event.dataTransfer?.files ?? [])];
    if (!files.length) return;
    event.preventDefault();
    event.stopPropagation();
    mark(0);
    onfiles(files);
  });
  return () => controller.abort();
}

const carriesFile = (event: DragEvent): boolean => event.dataTransfer?.types.includes("Files") ?? false;

/** A ref for an element that accepts dropped files. */
export function useDrops<Target extends HTMLElement>(onfiles: (files: File[]) => void) {
  const element = useRef<Target>(null);
  const latest = useRef(onfiles);
  latest.current = onfiles;
  useEffect(() => (element.current ? acceptDrops(element.current, (files) => latest.current(files)) : undefined), []);
  return element;
}

export interface DropzoneProps {
  /** As the attribute of a file input. */
  accept: string;
  label: string;
  /** More than one file only with `multiple`. */
  onfiles(files: File[]): void;
  multiple?: boolean;
  class?: string;
  hidden?: boolean;
  children: ComponentChildren;
}

export function Dropzone({
  accept,
  label,
  onfiles,
  multiple = false,
  class: name = "",
  hidden,
  children,
}: DropzoneProps) {
  const take = (files: File[]) => files.length && onfiles(multiple ? files : files.slice(0, 1));
  return (
    <label class={`drop ${name}`} hidden={hidden ?? false} ref={useDrops<HTMLLabelElement>(take)}>
      <input
        type="file"
        accept={accept}
        multiple={multiple}
        aria-label={label}
        class="drop-input"
        onChange={({ currentTarget: input }) => {
          take([...(input.files ?? [])]);
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

/** The inputs of a method besides the video: a drop zone for each, which shows the chosen file. */

import { asProblem, asset as assetOf, mediaUrl, paths } from "../api/api";
import type { Asset, FileInput, Inputs } from "../api/schemas";
import { h } from "../ui/dom";
import { bytes, percent } from "../ui/format";
import { icon, iconButton } from "../ui/icons";
import { upload } from "../ui/upload";
import { ACCEPT, createDropzone } from "./dropzone";

export interface InputSlots {
  element: HTMLElement;
  values(): Inputs;
  /** Show a problem at the input of that name; false if there is no such input. */
  problem(name: string, text: string): boolean;
  quiet(): void;
}

/** `specs`: the method's inputs without `video`; `given`: assets of the draft. */
export function createInputs(specs: FileInput[], given: Inputs, onchange: () => void): InputSlots {
  const slots = specs.map((spec) => createSlot(spec, given[spec.name] ?? "", onchange));
  const shown = slots.filter((slot) => !rare(slot)).map((slot) => slot.element);
  return {
    element: h("div", { class: "inputs", hidden: !specs.length }, shown, folded(slots.filter(rare))),
    values: () => Object.fromEntries(slots.filter((slot) => slot.id).map((slot) => [slot.spec.name, slot.id])),
    quiet() {
      for (const slot of slots) slot.complain("");
    },
    problem(name, text) {
      const slot = slots.find((candidate) => candidate.spec.name === name);
      slot?.complain(text);
      slot?.element.closest("details")?.setAttribute("open", "");
      return Boolean(slot);
    },
  };
}

interface Slot {
  spec: FileInput;
  /** The asset's id, or empty. */
  id: string;
  element: HTMLElement;
  complain(text: string): void;
}

/** Pictures and films come first; inputs that few users have are folded away unless they are required. */
const rare = ({ spec }: Slot): boolean =>
  !spec.required && (["json", "images"].includes(spec.kind) || /guide|lines/.test(spec.name));

function folded(slots: Slot[]): HTMLElement | false {
  if (!slots.length) return false;
  const open = slots.some((slot) => slot.id);
  return h(
    "details",
    { class: "more-inputs", open },
    h("summary", {}, "Advanced inputs"),
    slots.map((slot) => slot.element),
  );
}

function createSlot(spec: FileInput, id: string, onchange: () => void): Slot {
  const error = h("p", { class: "field-error" });
  const content = h("div", { class: "slot-content" });
  const title = h(
    "div",
    { class: "slot-title" },
    spec.title,
    !spec.required && h("span", { class: "optional" }, "optional"),
  );
  const element = h("div", { class: "slot" }, title, content, error);
  const slot: Slot = { spec, id, element, complain };

  function complain(text: string): void {
    error.textContent = text;
    element.classList.toggle("wrong", Boolean(text));
  }

  function empty(): void {
    const options = {
      accept: ACCEPT[spec.kind],
      label: `${spec.title}: choose a file`,
      onfile: take,
      class: "drop-small",
    };
    content.replaceChildren(createDropzone(options, icon("image"), h("span", {}, spec.help)));
  }

  async function take(file: File): Promise<void> {
    const status = h("span", {}, "Uploading…");
    const onProgress = (fraction: number) => {
      status.textContent = `Uploading… ${percent(fraction)}`;
    };
    content.replaceChildren(h("div", { class: "slot-file" }, status));
    complain("");
    try {
      keep(await upload(file, { onProgress }));
      onchange();
    } catch (error) {
      const problem = asProblem(error);
      empty();
      complain([problem.message, problem.remedy].join(" "));
    }
  }

  function keep(asset: Asset): void {
    slot.id = asset.id;
    const text = h("span", { class: "slot-name" }, asset.filename, h("small", {}, bytes(asset.size_bytes)));
    const remove = iconButton("close", `Remove ${spec.title}`, drop);
    content.replaceChildren(h("div", { class: "slot-file" }, thumbnail(asset), text, remove));
  }

  function drop(): void {
    slot.id = "";
    complain("");
    empty();
    onchange();
  }

  empty();
  if (id) assetOf(id).then(keep, drop);
  return slot;
}

function thumbnail(asset: Asset): Node {
  if (!["image", "video"].includes(asset.kind)) return icon("image");
  const still = asset.media_type.startsWith("image/");
  const picture = still ? h("img", { alt: "" }) : h("video", { muted: true, preload: "metadata" });
  mediaUrl(paths.content(asset.id)).then((url) => {
    picture.src = url;
  });
  return h("span", { class: "slot-thumb" }, picture);
}

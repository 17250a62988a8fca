/** The inputs of a method besides the video: a drop for each, with what was dropped shown in it. */

import { asset as assetOf, mediaUrl, paths } from "./api.js";
import { ACCEPT, createDropzone } from "./dropzone.js";
import { h, icon, iconButton } from "./dom.js";
import { bytes, percent } from "./format.js";
import { upload } from "./upload.js";

/**
 * @param {object[]} specs the method's inputs, without `video`
 * @param {Object<string, string>} given input name to asset id, from the draft
 * @returns {{element, values(): Object<string, string>, problem(name, text): boolean, quiet()}}
 */
export function createInputs(specs, given, onchange) {
  const slots = specs.map((spec) => createSlot(spec, given[spec.name] ?? "", onchange));
  return {
    element: h("div", { class: "inputs", hidden: !specs.length }, elements(slots.filter((slot) => !rare(slot))), folded(slots.filter(rare))),
    values: () => Object.fromEntries(slots.filter((slot) => slot.id).map((slot) => [slot.spec.name, slot.id])),
    quiet: () => slots.forEach((slot) => slot.complain("")),
    problem(name, text) {
      const slot = slots.find((candidate) => candidate.spec.name === name);
      slot?.complain(text);
      slot?.element.closest("details")?.setAttribute("open", "");
      return Boolean(slot);
    },
  };
}

/** Pictures and films come first; what few have at hand is folded away unless it is given or needed. */
const rare = ({ spec }) => ["json", "images"].includes(spec.kind) && !spec.required;
const elements = (slots) => slots.map((slot) => slot.element);

function folded(slots) {
  if (!slots.length) return false;
  const open = slots.some((slot) => slot.id);
  return h("details", { class: "more-inputs", open }, h("summary", {}, "More to go by"), elements(slots));
}

function createSlot(spec, id, onchange) {
  const error = h("p", { class: "field-error" });
  const content = h("div", { class: "slot-content" });
  const element = h("div", { class: "slot" }, h("div", { class: "slot-title" }, spec.title, !spec.required && h("span", { class: "optional" }, "optional")), content, error);
  const slot = { spec, id, element, complain };

  function complain(text) {
    error.textContent = text;
    element.classList.toggle("wrong", Boolean(text));
  }

  function empty() {
    const label = `${spec.title}: choose a file`;
    content.replaceChildren(createDropzone({ accept: ACCEPT[spec.kind] ?? "", label, onfile: take, class: "drop-small" }, icon("image"), h("span", {}, spec.help)));
  }

  async function take(file) {
    const status = h("span", {}, "Uploading…");
    content.replaceChildren(h("div", { class: "slot-file" }, status));
    complain("");
    try {
      keep(await upload(file, { onProgress: (f) => (status.textContent = `Uploading… ${percent(f)}`) }));
      onchange();
    } catch (problem) {
      empty();
      complain([problem.message, problem.remedy].join(" "));
    }
  }

  function keep(asset) {
    slot.id = asset.id;
    const text = h("span", { class: "slot-name" }, asset.filename, h("small", {}, bytes(asset.size_bytes)));
    content.replaceChildren(h("div", { class: "slot-file" }, thumbnail(asset), text, iconButton("close", `Remove ${spec.title}`, drop)));
  }

  function drop() {
    slot.id = "";
    complain("");
    empty();
    onchange();
  }

  empty();
  if (id) assetOf(id).then(keep, drop);
  return slot;
}

function thumbnail(asset) {
  if (!["image", "video"].includes(asset.kind)) return icon("image");
  const picture = asset.media_type.startsWith("image/") ? h("img", { alt: "" }) : h("video", { muted: true, preload: "metadata" });
  mediaUrl(paths.content(asset.id)).then((url) => (picture.src = url));
  return h("span", { class: "slot-thumb" }, picture);
}

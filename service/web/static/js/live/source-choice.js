/** Which camera, the screen, or which file. */

import { ACCEPT, createDropzone } from "../dropzone.js";
import { fill, h, icon, unique } from "../dom.js";
import { cameras } from "./source.js";

const KINDS = { camera: "Camera", screen: "Screen", file: "Video file" };
const HAS_SCREEN = !navigator.mediaDevices || "getDisplayMedia" in navigator.mediaDevices;

/**
 * @param {function()} onchoose the user chose another source
 * @returns {{element, kinds: string[], kind: string, file: File|null, wishes(): object, take(file), pick(), next(), several: boolean, refresh(source): Promise}}
 *     `pick` opens the file dialog, `next` is the other camera, `refresh` lists the cameras now that one is allowed
 */
export function createSourceChoice(onchoose) {
  const name = unique("source");
  const kinds = Object.keys(KINDS).filter((kind) => kind !== "screen" || HAS_SCREEN);
  const boxes = kinds.map((kind) => h("input", { type: "radio", name, value: kind, onchange: () => choose(kind) }));
  const segments = h("div", { class: "segments", role: "radiogroup", "aria-label": "Source" }, kinds.map((kind, i) => h("label", { class: "segment" }, boxes[i], h("span", {}, KINDS[kind]))));
  const device = h("select", { "aria-label": "Camera", hidden: true, onchange: onchoose });
  const fileName = h("span", {}, "Drop a video or choose one; it plays in a loop.");
  const drop = createDropzone({ accept: ACCEPT.video.replace(",.zip", ""), label: "Choose a video to play", onfile: take, class: "drop-small" }, icon("film"), fileName);
  let kind = window.isSecureContext ? "camera" : "file";
  let file = null;
  let listed = [];
  show();

  function show() {
    boxes.forEach((box) => (box.checked = box.value === kind));
    drop.hidden = kind !== "file";
    device.hidden = kind !== "camera" || listed.length < 2;
  }

  function choose(chosen) {
    kind = chosen;
    show();
    if (kind !== "file" || file) onchoose();
  }

  function take(given) {
    file = given;
    fileName.textContent = file.name;
    choose("file");
  }

  async function refresh(source) {
    listed = await cameras();
    fill(device, listed.map(({ deviceId, label }, i) => h("option", { value: deviceId, selected: deviceId === source?.deviceId }, label || `Camera ${i + 1}`)));
    show();
  }

  return {
    element: h("div", { class: "source-choice" }, segments, device, drop),
    kinds,
    get kind() {
      return kind;
    },
    set kind(chosen) {
      kind = chosen;
      show();
    },
    get several() {
      return kind === "camera" && listed.length > 1;
    },
    get file() {
      return file;
    },
    wishes: () => ({ deviceId: listed.length > 1 ? device.value : "", file }),
    take,
    pick: () => drop.querySelector("input").click(),
    next() {
      device.selectedIndex = (device.selectedIndex + 1) % listed.length;
      onchoose();
    },
    refresh,
  };
}

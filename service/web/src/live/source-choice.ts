/** Choosing a camera, the screen, or a file. */

import { ACCEPT, createDropzone } from "../forms/dropzone";
import { fill, h, unique } from "../ui/dom";
import { icon } from "../ui/icons";
import { listCameras, type Source, type SourceWishes } from "./source";
import type { SourceKind } from "./types";

const TITLES: Record<SourceKind, string> = { camera: "Camera", screen: "Screen", file: "Video file" };
const ALL: SourceKind[] = ["camera", "screen", "file"];
const HAS_SCREEN = !navigator.mediaDevices || "getDisplayMedia" in navigator.mediaDevices;

export interface SourceChoice {
  element: HTMLElement;
  /** The sources that this browser has. */
  kinds: SourceKind[];
  kind: SourceKind;
  readonly file: File | null;
  /** Whether there is more than one camera. */
  readonly several: boolean;
  wishes(): Pick<SourceWishes, "deviceId" | "file">;
  take(file: File): void;
  /** Open the file dialog. */
  pick(): void;
  /** Choose the other camera. */
  next(): void;
  /** List the cameras, now that one is allowed. */
  refresh(source: Source | null): Promise<void>;
}

/** `onchoose` is called when the user chose another source. */
export function createSourceChoice(onchoose: () => void): SourceChoice {
  const name = unique("source");
  const kinds = ALL.filter((each) => each !== "screen" || HAS_SCREEN);
  const boxes = kinds.map((value) => h("input", { type: "radio", name, value, onchange: () => choose(value) }));
  const labels = kinds.map((each, i) => h("label", { class: "segment" }, boxes[i], h("span", {}, TITLES[each])));
  const segments = h("div", { class: "segments", role: "radiogroup", "aria-label": "Source" }, labels);
  const device = h("select", { "aria-label": "Camera", hidden: true, onchange: onchoose });
  const fileName = h("span", {}, "Drop a video or choose one; it plays in a loop.");
  const options = {
    accept: ACCEPT.video.replace(",.zip", ""),
    label: "Choose a video to play",
    onfile: take,
    class: "drop-small",
  };
  const drop = createDropzone(options, icon("film"), fileName);
  let kind: SourceKind = window.isSecureContext ? "camera" : "file";
  let file: File | null = null;
  let cameras = 0;
  show();

  function show(): void {
    for (const box of boxes) box.checked = box.value === kind;
    drop.hidden = kind !== "file";
    device.hidden = kind !== "camera" || cameras < 2;
  }

  function choose(chosen: SourceKind): void {
    kind = chosen;
    show();
    if (kind !== "file" || file) onchoose();
  }

  function take(given: File): void {
    file = given;
    fileName.textContent = given.name;
    choose("file");
  }

  async function refresh(source: Source | null): Promise<void> {
    const listed = await listCameras();
    cameras = listed.length;
    const option = ({ deviceId, label }: { deviceId: string; label: string }, i: number) =>
      h("option", { value: deviceId, selected: deviceId === source?.deviceId }, label || `Camera ${i + 1}`);
    fill(device, listed.map(option));
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
      return kind === "camera" && cameras > 1;
    },
    get file() {
      return file;
    },
    wishes: () => ({ deviceId: cameras > 1 ? device.value : "", file }),
    take,
    pick: () => drop.querySelector("input")?.click(),
    next() {
      device.selectedIndex = (device.selectedIndex + 1) % cameras;
      onchoose();
    },
    refresh,
  };
}

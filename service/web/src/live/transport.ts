/** The row under the picture: record, view, mirror, other camera, full screen. */

import { h } from "../ui/dom";
import { bytes, clock } from "../ui/format";
import { icon, iconButton } from "../ui/icons";
import { canRecord } from "./recorder";
import type { LiveView, Screen } from "./screen";

const VIEWS: [string, LiveView][] = [
  ["Painted", "painted"],
  ["Compare", "wipe"],
  ["Side by side", "beside"],
];

export interface TransportOptions {
  screen: Screen;
  /** The element that fills the screen. */
  stage(): HTMLElement;
  onrecord(): void;
  onflip(): void;
}

export interface Transport {
  element: HTMLElement;
  running(on: boolean): void;
  setRecording(on: boolean): void;
  recorded(seconds: number, size: number): void;
  /** Whether there is another camera to switch to. */
  setSeveral(yes: boolean): void;
  setMirrored(on: boolean): void;
}

export function createTransport({ screen, stage, onrecord, onflip }: TransportOptions): Transport {
  const label = h("span", {}, "Record");
  const recordProps = {
    type: "button",
    class: "button small live-record",
    "aria-pressed": "false",
    hidden: !canRecord(),
    disabled: true,
  };
  const record = h("button", { ...recordProps, onclick: onrecord }, icon("record"), label);
  const mirror = iconButton("mirror", "Mirror the picture", () => setMirrored(!screen.mirrored), {
    "aria-pressed": "false",
  });
  const flip = iconButton("turn", "Other camera", onflip, { hidden: true });
  const full = iconButton("full", "Full screen", () => {
    if (document.fullscreenElement) document.exitFullscreen();
    else stage().requestFullscreen();
  });
  full.hidden = !document.fullscreenEnabled;

  function setMirrored(on: boolean): void {
    mirror.setAttribute("aria-pressed", String(on));
    screen.mirrored = on;
  }

  return {
    element: h("div", { class: "transport live-transport" }, record, viewSwitch(screen), flip, mirror, full),
    running(on) {
      record.disabled = !on;
    },
    setRecording(on) {
      record.setAttribute("aria-pressed", String(on));
      label.textContent = on ? "Stop recording" : "Record";
    },
    recorded(seconds, size) {
      label.textContent = `Stop · ${clock(seconds).slice(0, -2)}${size ? ` · ${bytes(size)}` : ""}`;
    },
    setSeveral(yes) {
      flip.hidden = !yes;
    },
    setMirrored,
  };
}

/** Phones have no room for two pictures: they begin with the painting alone. */
function viewSwitch(screen: Screen): HTMLElement {
  const press = (chosen: LiveView) => {
    screen.view = chosen;
    buttons.forEach((button, i) => {
      button.setAttribute("aria-pressed", String(VIEWS[i]?.[1] === chosen));
    });
  };
  const buttons = VIEWS.map(([text, name]) => h("button", { type: "button", onclick: () => press(name) }, text));
  press(matchMedia("(max-width: 720px)").matches ? "painted" : "wipe");
  return h("div", { class: "views", role: "group", "aria-label": "View" }, buttons);
}

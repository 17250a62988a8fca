/** The row under the picture: record, what is shown, mirrored, the other camera, full screen. */

import { h, icon, iconButton } from "../dom.js";
import { bytes, clock } from "../format.js";
import { canRecord } from "./recorder.js";

const VIEWS = [["Painted", "painted"], ["Compare", "wipe"], ["Side by side", "beside"]];

/** @returns {{element, running(on), recorded(seconds, size), recording: boolean, several: boolean, mirrored: boolean}} */
export function createTransport({ screen, stage, onrecord, onflip }) {
  const label = h("span", {}, "Record");
  const record = h("button", { type: "button", class: "button small live-record", "aria-pressed": "false", hidden: !canRecord(), disabled: true, onclick: onrecord }, icon("record"), label);
  const mirror = iconButton("mirror", "Mirror the picture", () => (transport.mirrored = mirror.getAttribute("aria-pressed") !== "true"), { "aria-pressed": "false" });
  const flip = iconButton("turn", "Other camera", onflip, { hidden: true });
  const full = iconButton("full", "Full screen", () => (document.fullscreenElement ? document.exitFullscreen() : stage().requestFullscreen()));
  full.hidden = !document.fullscreenEnabled;

  const transport = {
    element: h("div", { class: "transport live-transport" }, record, viewSwitch(screen), flip, mirror, full),
    running: (on) => (record.disabled = !on),
    set recording(on) {
      record.setAttribute("aria-pressed", String(on));
      label.textContent = on ? "Stop recording" : "Record";
    },
    recorded: (seconds, size) => (label.textContent = `Stop · ${clock(seconds).slice(0, -2)}${size ? ` · ${bytes(size)}` : ""}`),
    set several(yes) {
      flip.hidden = !yes;
    },
    set mirrored(on) {
      mirror.setAttribute("aria-pressed", String(on));
      screen.mirrored = on;
    },
  };
  return transport;
}

/** Phones have no room for two pictures: they begin with the painting alone. */
function viewSwitch(screen) {
  const press = (chosen) => {
    screen.view = chosen;
    buttons.forEach((button, i) => button.setAttribute("aria-pressed", String(VIEWS[i][1] === chosen)));
  };
  const buttons = VIEWS.map(([text, name]) => h("button", { type: "button", onclick: () => press(name) }, text));
  press(matchMedia("(max-width: 720px)").matches ? "painted" : "wipe");
  return h("div", { class: "views", role: "group", "aria-label": "View" }, buttons);
}

/** What is going on, in words: a pill above the picture, and a line on it while there is something to wait for. */

import { h } from "../dom.js";

const WORDS = {
  idle: ["Not running", ""],
  asking: ["Waiting for your permission", "Allow it in the browser’s question"],
  opening: ["Opening", "Opening the video…"],
  connecting: ["Connecting", "Connecting…"],
  starting: ["Live", "Painting the first frame…"],
  live: ["Live", ""],
  paused: ["Paused while out of sight", ""],
  busy: ["All places are taken", "All places are taken. Trying again"],
  lost: ["Connection lost", "Connection lost. Trying again"],
  failed: ["Stopped", ""],
};
const WAITING = new Set(["asking", "opening", "connecting", "starting", "busy", "lost"]);

/** @returns {{pill, line, busy, show(name, until?): void, name: string}} `until` on the clock of `performance.now()` */
export function createStatus() {
  const text = h("span", { role: "status" });
  const pill = h("p", { class: "live-pill" }, h("span", { class: "live-dot", "aria-hidden": "true" }), text);
  const line = h("p", { class: "stage-status", "aria-hidden": "true" });
  const sweep = h("div", { class: "stage-busy" });
  let name = "";
  let timer = 0;

  function show(next, until = 0) {
    name = next;
    pill.dataset.state = next;
    text.textContent = WORDS[next][0];
    clearInterval(timer);
    count(until);
    if (until > performance.now()) timer = setInterval(count, 250, until);
  }

  /** The seconds are for the eye only: nobody wants them read out. */
  function count(until) {
    const seconds = Math.ceil((until - performance.now()) / 1000);
    const words = WORDS[name][1];
    line.textContent = words && until ? `${words}${seconds > 0 ? ` in ${seconds} s` : " now"}…` : words;
  }

  show("idle");
  return {
    pill,
    overlay: [sweep, line],
    show,
    get name() {
      return name;
    },
    get waiting() {
      return WAITING.has(name);
    },
  };
}

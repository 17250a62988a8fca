/** The state of the session in words: a pill above the picture, and a line on it while the user has to wait. */

import { h } from "../ui/dom";

const WORDS = {
  idle: ["Not running", ""],
  asking: ["Waiting for your permission", "Allow it in the browser’s question"],
  opening: ["Opening", "Opening the video…"],
  connecting: ["Connecting", "Connecting…"],
  starting: ["Live", "Painting the first frame…"],
  live: ["Live", ""],
  paused: ["Paused while the tab is hidden", ""],
  busy: ["All places are taken", "All places are taken. Trying again"],
  lost: ["Connection lost", "Connection lost. Trying again"],
  failed: ["Stopped", ""],
} as const;

export type StatusName = keyof typeof WORDS;
const WAITING = new Set<StatusName>(["asking", "opening", "connecting", "starting", "busy", "lost"]);

export interface Status {
  pill: HTMLElement;
  /** Elements over the picture. */
  overlay: HTMLElement[];
  /** `until`: time of the next attempt, on the clock of `performance.now()`. */
  show(name: StatusName, until?: number): void;
  readonly name: StatusName;
  readonly waiting: boolean;
}

export function createStatus(): Status {
  const text = h("span", { role: "status" });
  const pill = h("p", { class: "live-pill" }, h("span", { class: "live-dot", "aria-hidden": "true" }), text);
  const line = h("p", { class: "stage-status", "aria-hidden": "true" });
  const busy = h("div", { class: "stage-busy" });
  let name: StatusName = "idle";
  let timer = 0;

  function show(next: StatusName, until = 0): void {
    name = next;
    pill.dataset.state = next;
    text.textContent = WORDS[next][0];
    clearInterval(timer);
    count(until);
    if (until > performance.now()) timer = window.setInterval(count, 250, until);
  }

  /** The seconds are shown only, since reading each one out would be a nuisance. */
  function count(until: number): void {
    const seconds = Math.ceil((until - performance.now()) / 1000);
    const words = WORDS[name][1];
    line.textContent = words && until ? `${words}${seconds > 0 ? ` in ${seconds} s` : " now"}…` : words;
  }

  show("idle");
  return {
    pill,
    overlay: [busy, line],
    show,
    get name() {
      return name;
    },
    get waiting() {
      return WAITING.has(name);
    },
  };
}

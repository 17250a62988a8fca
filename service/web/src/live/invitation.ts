/** The card over the picture while no session runs: the ways to begin, or the fault and its remedy. */

import type { Problem } from "../api/api";
import { fill, h } from "../ui/dom";
import { type IconName, icon } from "../ui/icons";
import { problemBlock } from "../ui/notices";
import type { SourceKind } from "./types";

const WAYS: Record<SourceKind, [IconName, string]> = {
  camera: ["camera", "Use the camera"],
  screen: ["screen", "Share the screen"],
  file: ["film", "Play a video"],
};

export interface Invitation {
  element: HTMLElement;
  invite(): void;
  /** `again` tries the same once more. */
  complain(problem: Problem, again: () => void): void;
  hide(): void;
}

/** `kinds`: sources that this browser has. */
export function createInvitation(kinds: SourceKind[], onchoose: (kind: SourceKind) => void): Invitation {
  const content = h("div", { class: "live-card" });
  const element = h("div", { class: "live-invitation" }, content);

  function way(kind: SourceKind, i: number): HTMLElement {
    const [symbol, text] = WAYS[kind];
    const style = `button ${i === 0 ? "primary" : ""}`;
    return h("button", { type: "button", class: style, onclick: () => onchoose(kind) }, icon(symbol), text);
  }

  function invite(): void {
    const ordered: SourceKind[] = window.isSecureContext ? kinds : ["file"];
    const lead = window.isSecureContext ? "See your camera's picture painted while you move." : insecure();
    const privacy = "or drop a video here. Frames go to this service only, and none is kept.";
    const ways = h("div", { class: "live-ways" }, ordered.map(way));
    fill(content, h("h2", {}, "Live painting"), h("p", {}, lead), ways, h("p", { class: "drop-hint" }, privacy));
    element.hidden = false;
  }

  function complain(problem: Problem, again: () => void): void {
    const retry = h("button", { type: "button", class: "button primary", onclick: again }, "Try again");
    const other = h("button", { type: "button", class: "button", onclick: () => onchoose("file") }, "Play a video");
    fill(content, problemBlock(problem, retry, problem.code !== "offline" && other));
    element.hidden = false;
  }

  invite();
  return {
    element,
    invite,
    complain,
    hide() {
      element.hidden = true;
    },
  };
}

function insecure(): string {
  const local = `http://localhost${location.port && `:${location.port}`}/live`;
  return `Browsers give cameras to secure pages only, and ${location.origin} is not one. Open this page on the machine itself (${local}) or put the service behind HTTPS. A video works here too.`;
}

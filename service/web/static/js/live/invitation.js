/** What lies on the picture while nothing runs: the ways to begin, or what went wrong and what to do. */

import { fill, h, icon } from "../dom.js";
import { problemBlock } from "../notices.js";

const WAYS = { camera: ["camera", "Use the camera"], screen: ["screen", "Share the screen"], file: ["film", "Play a video"] };

/** @param {string[]} kinds of source that this browser has @param {function(string)} onchoose */
export function createInvitation(kinds, onchoose) {
  const content = h("div", { class: "live-card" });
  const element = h("div", { class: "live-invitation" }, content);

  function way(kind, i) {
    const [sign, text] = WAYS[kind];
    return h("button", { type: "button", class: `button ${i === 0 ? "primary" : ""}`, onclick: () => onchoose(kind) }, icon(sign), text);
  }

  function invite() {
    const ordered = window.isSecureContext ? kinds : ["file"];
    const lead = window.isSecureContext ? "Step in front of the camera and see yourself painted, as you move." : insecure();
    const promise = "or drop a video here. Frames go to this service only, and nothing is kept.";
    fill(content, h("h2", {}, "Your world, painted live"), h("p", {}, lead), h("div", { class: "live-ways" }, ordered.map(way)), h("p", { class: "drop-hint" }, promise));
    element.hidden = false;
  }

  /** `again` tries the same once more. */
  function complain(problem, again) {
    const retry = h("button", { type: "button", class: "button primary", onclick: again }, "Try again");
    const file = problem.code !== "offline" && h("button", { type: "button", class: "button", onclick: () => onchoose("file") }, "Play a video");
    fill(content, problemBlock(problem, retry, file));
    element.hidden = false;
  }

  invite();
  return { element, invite, complain, hide: () => (element.hidden = true) };
}

const insecure = () =>
  `Browsers give cameras to secure pages only, and ${location.origin} is not one. Open this page on the machine itself (http://localhost${location.port && `:${location.port}`}/live) or put the service behind HTTPS. A video works here too.`;

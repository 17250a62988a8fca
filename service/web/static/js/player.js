/** Two films in step, one over the other: the result leads, the original follows, frame by frame if it cannot play. */

import { h, iconButton, relabel } from "./dom.js";
import { clock } from "./format.js";
import { createStills } from "./stills.js";
import { createWipe } from "./wipe.js";

const SEEK_BEYOND_S = 0.2;
const NUDGE_BEYOND_S = 0.02;
const calm = () => matchMedia("(prefers-reduced-motion: reduce)").matches;

/**
 * @param {{asset: object, before: string, after: string, poster?: string}} films the original, and addresses: `before` is
 *     empty where the browser cannot play it
 * @returns {{element, close()}}
 */
export function createPlayer({ asset, before, after, poster }) {
  const follower = film(before, { muted: true, tabindex: "-1", "aria-hidden": "true" });
  const leader = film(after, { poster, muted: true, "aria-label": "The painted film" });
  const wipe = createWipe({ before: follower, after: leader });
  const frame = h("div", { class: "frame" }, wipe.element);
  const element = h("div", { class: "player", role: "group", "aria-label": "Player" }, frame, controls(leader, wipe, () => element));
  const steps = [keepInStep(leader, follower)];
  frame.style.setProperty("--ratio", String(asset.info.width / asset.info.height));
  const unplayable = () => {
    if (steps.length > 1 || !leader.hasAttribute("src")) return;
    const stills = createStills(asset.id, { alt: "", "aria-hidden": "true" });
    follower.replaceWith(stills.element);
    stills.onfail(() => (element.classList.add("no-original"), wipe.alone("after")));
    steps.push(followByFrame(leader, stills, asset.info.fps || 25));
  };
  follower.addEventListener("error", unplayable);
  follower.addEventListener("loadedmetadata", () => follower.videoWidth || unplayable());
  if (!before) unplayable();
  element.addEventListener("keydown", (event) => {
    if (event.key !== " " || event.target.closest("button, input")) return;
    event.preventDefault();
    toggle(leader);
  });
  if (!calm()) leader.play().catch(() => {});
  return { element, close: () => steps.forEach((close) => close()) };
}

const film = (src, props) => h("video", { ...(src && { src }), class: "picture", playsinline: "", preload: "auto", loop: true, ...props });
const toggle = (video) => (video.paused ? video.play().catch(() => {}) : video.pause());

/** Let the follower do what the leader does; small drift is nudged away, large drift is a seek. */
function keepInStep(leader, follower) {
  let pending = 0;
  const align = () => (follower.currentTime = Math.min(leader.currentTime, follower.duration || Infinity));
  const tick = () => {
    const drift = follower.currentTime - leader.currentTime;
    if (Math.abs(drift) > SEEK_BEYOND_S && !follower.seeking) align();
    follower.playbackRate = leader.playbackRate * (Math.abs(drift) > NUDGE_BEYOND_S ? 1 - Math.sign(drift) * 0.1 : 1);
    pending = requestAnimationFrame(tick);
  };
  leader.addEventListener("play", () => {
    follower.play().catch(() => {});
    cancelAnimationFrame(pending);
    tick();
  });
  leader.addEventListener("pause", () => {
    cancelAnimationFrame(pending);
    follower.pause();
    align();
  });
  leader.addEventListener("seeking", align);
  follower.addEventListener("loadedmetadata", align);
  return () => {
    cancelAnimationFrame(pending);
    for (const video of [leader, follower]) {
      video.removeAttribute("src");
      video.load();
    }
  };
}

/** Show the original's frame of the moment; while the film plays, as many as the service can decode. */
function followByFrame(leader, stills, fps) {
  let pending = 0;
  const show = () => stills.show(leader.currentTime * fps + 0.01);
  const tick = () => {
    show();
    pending = requestAnimationFrame(tick);
  };
  const stop = () => cancelAnimationFrame(pending);
  leader.addEventListener("play", () => (stop(), tick()));
  leader.addEventListener("pause", stop);
  leader.addEventListener("seeked", show);
  if (leader.paused) show();
  else tick();
  return () => (stop(), stills.close());
}

function controls(leader, wipe, player) {
  const play = iconButton("play", "Play", () => toggle(leader));
  leader.addEventListener("play", () => relabel(play, "pause", "Pause"));
  leader.addEventListener("pause", () => relabel(play, "play", "Play"));
  const full = iconButton("full", "Full screen", () => (document.fullscreenElement ? document.exitFullscreen() : player().requestFullscreen()));
  full.hidden = !document.fullscreenEnabled;
  return h("div", { class: "transport" }, play, ...timeline(leader), soundButton(leader), viewSwitch(wipe), full);
}

function timeline(leader) {
  const track = h("input", { type: "range", min: "0", max: "1", step: "any", value: "0", "aria-label": "Position" });
  const time = h("output", { class: "time" }, "0:00.0");
  const show = () => {
    const done = leader.currentTime / (leader.duration || 1);
    track.value = String(done);
    track.style.setProperty("--fill", String(done));
    track.setAttribute("aria-valuetext", clock(leader.currentTime));
    time.textContent = `${clock(leader.currentTime)} / ${clock(leader.duration)}`;
  };
  for (const event of ["timeupdate", "loadedmetadata", "seeked"]) leader.addEventListener(event, show);
  track.addEventListener("input", () => (leader.currentTime = Number(track.value) * (leader.duration || 0)));
  return [track, time];
}

function soundButton(leader) {
  const button = iconButton("muted", "Sound on", () => (leader.muted = !leader.muted));
  leader.addEventListener("volumechange", () => (leader.muted ? relabel(button, "muted", "Sound on") : relabel(button, "sound", "Sound off")));
  return button;
}

/** Both with the handle, or one of them alone. */
function viewSwitch(wipe) {
  const views = [["Original", "before"], ["Compare", null], ["Painted", "after"]];
  const press = (chosen) => {
    wipe.alone(chosen);
    buttons.forEach((button, i) => button.setAttribute("aria-pressed", String(views[i][1] === chosen)));
  };
  const buttons = views.map(([text, what]) => h("button", { type: "button", onclick: () => press(what) }, text));
  press(null);
  return h("div", { class: "views", role: "group", "aria-label": "View" }, buttons);
}

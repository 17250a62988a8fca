/** Two films in step, one over the other: the painted film leads, the original follows, frame by frame if it cannot play. */

import type { Asset } from "../api/schemas";
import type { View } from "../ui/dom";
import { h, type Props } from "../ui/dom";
import { clock } from "../ui/format";
import { iconButton, relabel } from "../ui/icons";
import { createStills, type Stills } from "../ui/stills";
import { createWipe, type Side, type Wipe } from "../ui/wipe";

const SEEK_BEYOND_S = 0.2;
const NUDGE_BEYOND_S = 0.02;
const calm = (): boolean => matchMedia("(prefers-reduced-motion: reduce)").matches;

export interface Films {
  /** The original. */
  asset: Asset;
  /** Address of the original, or empty where the browser cannot play it. */
  before: string;
  /** Address of the painted film. */
  after: string;
  poster: string | null;
  /** The original's frame that the painted film begins with. */
  first: number;
  /** Names of both; "Original" and "Painted" if left out. */
  labels?: [before: string, after: string];
}

/** The element fires `frame` with the number of the film's frame at which it stops. */
export interface Player extends View {
  /** Stop at this frame of the painted film. */
  showFrame(frame: number): void;
}

export function createPlayer({ asset, before, after, poster, first, labels = ["Original", "Painted"] }: Films): Player {
  const follower = film(before, { muted: true, tabindex: "-1", "aria-hidden": "true" });
  const leader = film(after, { poster, muted: true, "aria-label": "The painted film" });
  const wipe = createWipe({ before: follower, after: leader }, labels);
  const frame = h("div", { class: "frame" }, wipe.element);
  const element: HTMLElement = h(
    "div",
    { class: "player", role: "group", "aria-label": "Player" },
    frame,
    controls(leader, wipe, labels, () => element),
  );
  const fps = asset.info.fps || 25;
  const closers = [keepInStep(leader, follower, first / fps)];
  frame.style.setProperty("--ratio", String((asset.info.width ?? 16) / (asset.info.height ?? 9)));

  function useStills(): void {
    if (closers.length > 1 || !leader.hasAttribute("src")) return;
    const stills = createStills(asset.id, { alt: "", "aria-hidden": "true" });
    follower.replaceWith(stills.element);
    stills.onfail(() => {
      element.classList.add("no-original");
      wipe.alone("after");
    });
    closers.push(followByFrame(leader, stills, fps, first));
  }

  follower.addEventListener("error", useStills);
  follower.addEventListener("loadedmetadata", () => follower.videoWidth || useStills());
  if (!before) useStills();
  element.addEventListener("keydown", (event) => {
    if (event.key !== " " || (event.target as Element).closest("button, input")) return;
    event.preventDefault();
    toggle(leader);
  });
  for (const event of ["pause", "seeked"])
    leader.addEventListener(event, () => {
      if (!leader.paused) return;
      const detail = Math.floor(leader.currentTime * fps + 0.01);
      element.dispatchEvent(new CustomEvent("frame", { detail, bubbles: true }));
    });
  if (!calm()) leader.play().catch(() => {});
  return {
    element,
    close() {
      for (const close of closers) close();
    },
    showFrame(frame) {
      leader.pause();
      leader.currentTime = (frame + 0.5) / fps;
    },
  };
}

const film = (src: string, props: Props): HTMLVideoElement =>
  h("video", { ...(src && { src }), class: "picture", playsinline: "", preload: "auto", loop: true, ...props });

function toggle(video: HTMLVideoElement): void {
  if (video.paused) video.play().catch(() => {});
  else video.pause();
}

/**
 * Let the follower do what the leader does, `startS` seconds further into its film; small drift is corrected by rate,
 * large drift by a seek.
 */
function keepInStep(leader: HTMLVideoElement, follower: HTMLVideoElement, startS: number): () => void {
  let pending = 0;
  const align = () => {
    follower.currentTime = Math.min(startS + leader.currentTime, follower.duration || Infinity);
  };
  const tick = () => {
    const drift = follower.currentTime - leader.currentTime - startS;
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

/** Show the original's frame at the leader's time; while the film plays, as many as the service can decode. */
function followByFrame(leader: HTMLVideoElement, stills: Stills, fps: number, first: number): () => void {
  let pending = 0;
  const show = () => stills.show(first + leader.currentTime * fps + 0.01);
  const tick = () => {
    show();
    pending = requestAnimationFrame(tick);
  };
  const stop = () => cancelAnimationFrame(pending);
  leader.addEventListener("play", () => {
    stop();
    tick();
  });
  leader.addEventListener("pause", stop);
  leader.addEventListener("seeked", show);
  if (leader.paused) show();
  else tick();
  return () => {
    stop();
    stills.close();
  };
}

function controls(
  leader: HTMLVideoElement,
  wipe: Wipe,
  labels: [string, string],
  player: () => HTMLElement,
): HTMLElement {
  const play = iconButton("play", "Play", () => toggle(leader));
  leader.addEventListener("play", () => relabel(play, "pause", "Pause"));
  leader.addEventListener("pause", () => relabel(play, "play", "Play"));
  const full = iconButton("full", "Full screen", () => {
    if (document.fullscreenElement) document.exitFullscreen();
    else player().requestFullscreen();
  });
  full.hidden = !document.fullscreenEnabled;
  return h("div", { class: "transport" }, play, timeline(leader), soundButton(leader), viewSwitch(wipe, labels), full);
}

function timeline(leader: HTMLVideoElement): HTMLElement[] {
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
  track.addEventListener("input", () => {
    leader.currentTime = Number(track.value) * (leader.duration || 0);
  });
  return [track, time];
}

function soundButton(leader: HTMLVideoElement): HTMLElement {
  const button = iconButton("muted", "Sound on", () => {
    leader.muted = !leader.muted;
  });
  leader.addEventListener("volumechange", () => {
    if (leader.muted) relabel(button, "muted", "Sound on");
    else relabel(button, "sound", "Sound off");
  });
  return button;
}

/** Both with the handle, or one of them alone. */
function viewSwitch(wipe: Wipe, [before, after]: [string, string]): HTMLElement {
  const views: [string, Side | null][] = [
    [before, "before"],
    ["Compare", null],
    [after, "after"],
  ];
  const press = (chosen: Side | null) => {
    wipe.alone(chosen);
    buttons.forEach((button, i) => {
      button.setAttribute("aria-pressed", String(views[i]?.[1] === chosen));
    });
  };
  const buttons = views.map(([text, what]) => h("button", { type: "button", onclick: () => press(what) }, text));
  press(null);
  return h("div", { class: "views", role: "group", "aria-label": "View" }, buttons);
}

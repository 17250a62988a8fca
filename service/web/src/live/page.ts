/** The live page: one source, one stream, one screen, and their connections. */

import { asProblem, Problem } from "../api/api";
import { type Draft, draftHash } from "../forms/draft";
import { acceptDrops } from "../forms/dropzone";
import { h } from "../ui/dom";
import { announce, notify, notifyOf } from "../ui/notices";
import { TITLES } from "./codecs";
import { createFigures, type Figures } from "./figures";
import { createInvitation } from "./invitation";
import { createMeters, type Meters } from "./meters";
import { createRecorder, type Recorder } from "./recorder";
import { createScreen } from "./screen";
import { type Choice, createSettings, type Settings } from "./settings";
import { openSource, type Source } from "./source";
import { createStatus, type StatusName } from "./status";
import { createStream, type Stream } from "./stream";
import { createTransport, type Transport } from "./transport";
import type { ConnectionState, Incoming, Ready, Shape, SourceKind, Stats } from "./types";

const SETTLE_MS = 400;
const SIZES: [number, number][] = [
  [320, 240],
  [640, 480],
  [1280, 720],
];
const START: Record<SourceKind, string> = {
  camera: "Start the camera",
  screen: "Share the screen",
  file: "Play the video",
};

export function createLivePage(choice: Choice, draft: Draft): HTMLElement {
  const status = createStatus();
  const meters = createMeters();
  const screen = createScreen(() => recorder.stop());
  const recorder: Recorder = createRecorder(screen.canvas, {
    ontick: (seconds, size) => transport.recorded(seconds, size),
    onended: () => transport.setRecording(false),
    onsaved: (name) => announce(`Saved as ${name}.`),
    onfault: notify,
  });
  const onwire = settled(() => stream?.renew());
  const settings: Settings = createSettings(choice, draft, {
    onsource: changeSource,
    onframes: changeFrames,
    onpaint: changePaint,
    onwire,
  });
  const invitation = createInvitation(settings.source.kinds, begin);
  const transport: Transport = createTransport({
    screen,
    stage: () => stage,
    onrecord: record,
    onflip: () => settings.source.next(),
  });
  const about = h("p", {});
  const summary = h("p", { class: "submit-hint" });
  const button = h("button", {
    type: "button",
    class: "button primary submit",
    onclick: () => (running() ? stop() : start()),
  });
  let source: Source | null = null;
  let stream: Stream | null = null;
  let figures: Figures | null = null;
  let connection: ConnectionState | null = null;
  let turn = 0;
  let ticking = 0;
  let rate = 0;

  // -- from source to stream

  const running = () => status.name !== "idle" && status.name !== "failed";

  function begin(kind: SourceKind): void {
    settings.source.kind = kind;
    if (kind === "file") settings.source.pick();
    else start();
  }

  async function start(): Promise<void> {
    const { kind, file } = settings.source;
    if (kind === "file" && !file) return settings.source.pick();
    const mine = ++turn;
    source?.stop();
    source = null;
    invitation.hide();
    show(kind === "file" ? "opening" : "asking");
    try {
      const opened = await openSource(kind, { ...settings.source.wishes(), ...shape() }, stop);
      if (mine === turn) run(opened);
      else opened.stop();
    } catch (error) {
      if (mine === turn) halt(asProblem(error));
    }
  }

  function run(opened: Source): void {
    source = opened;
    transport.setMirrored(opened.selfie);
    settings.source.refresh(opened).then(() => transport.setSeveral(settings.source.several));
    if (stream) {
      stream.attach(opened);
      if (connection) onstate(connection);
      return;
    }
    figures = createFigures();
    const events = { onstate, onready, onmessage, onpicture };
    stream = createStream({ screen, figures, settings: settings.values, events });
    ticking = window.setInterval(tick, 1000);
    stream.attach(opened);
    stream.open();
  }

  /** End the session, and report its figures. */
  function stop(): void {
    const farewell = endSession();
    invitation.invite();
    show("idle");
    farewell?.then((stats) => {
      if (stats && !running()) summary.textContent = `${stats.painted} of ${stats.received} frames were painted.`;
    });
  }

  function halt(problem: Problem): void {
    endSession();
    settings.problem(problem);
    invitation.complain(problem, start);
    show("failed");
  }

  function endSession(): Promise<Stats | null> | undefined {
    turn += 1;
    recorder.stop();
    clearInterval(ticking);
    const farewell = stream?.close();
    source?.stop();
    source = null;
    stream = null;
    screen.clear();
    return farewell;
  }

  // -- events of the stream

  function onstate(state: ConnectionState): void {
    connection = state;
    if (state.name === "failed") halt(state.problem);
    else if (state.name === "waiting") show(state.why, state.until);
    else if (state.name !== "closed") show(state.name === "live" ? "starting" : state.name);
  }

  function onready({ send, receive, fps }: Ready): void {
    rate = fps;
    meters.codecs(`${TITLES[send.codec]} up, ${TITLES[receive.codec]} down`);
  }

  function onpicture(): void {
    if (status.name === "starting") show("live");
  }

  function onmessage(message: Incoming): void {
    if (message.type === "stats" || message.type === "resolution") meters.heard(message);
    if (message.type === "params") settings.quiet();
    if (message.type === "error") {
      const problem = new Problem(message.problem);
      if (!settings.problem(problem)) notify(problem);
    }
    if (message.type === "replaced") {
      notifyOf({
        title: "Another worker took over",
        message: "The previous one was lost; shapes and colours may jump once.",
      });
    }
  }

  function tick(): void {
    if (!figures) return;
    const second = figures.second();
    meters.show(second, figures, settings.values().fps);
    const shown = status.name === "live" && second.glassMs;
    summary.textContent = shown ? `${Math.round(second.fps)} fps · ${Math.round(shown)} ms` : "";
    about.textContent = source ? `${source.label} · ${screen.canvas.width} × ${screen.canvas.height}` : "";
  }

  // -- changes by the user

  function changeSource(): void {
    const { kind, file } = settings.source;
    if (running() || (kind === "file" && file)) start();
    else show(status.name);
  }

  function changeFrames(): void {
    source?.adjust(shape());
    if (stream && settings.values().fps !== rate) stream.renew();
  }

  function changePaint(): void {
    settings.quiet();
    stream?.change();
    history.replaceState(null, "", draftHash(settings.draft()));
  }

  /** The size and rate to ask of a camera. */
  function shape(): Shape {
    const { area, fps } = settings.values();
    const [width, height] = SIZES.find(([w, h]) => w * h >= area) ?? [1280, 720];
    return { width, height, fps };
  }

  function record(): void {
    if (recorder.recording) {
      recorder.stop();
    } else {
      recorder.start();
      transport.setRecording(true);
    }
  }

  // -- appearance

  function show(name: StatusName, until?: number): void {
    status.show(name, until);
    frame.setAttribute("aria-busy", String(status.waiting));
    button.textContent = running() ? "Stop" : START[settings.source.kind];
    button.classList.toggle("primary", !running());
    transport.running(name === "live" || recorder.recording);
    if (running()) return;
    summary.textContent = "";
    about.textContent = "Paint a camera, a screen or a video while it runs.";
  }

  document.addEventListener("visibilitychange", () => {
    if (document.hidden && status.name === "live") show("paused");
    else if (!document.hidden && status.name === "paused") show("live");
  });
  window.addEventListener("pagehide", () => running() && stop());

  const frame = screen.element;
  frame.append(...status.overlay, invitation.element);
  acceptDrops(frame, settings.source.take);
  const stage = h("section", { class: "player live-stage", "aria-label": "Picture" }, frame, transport.element);
  const head = h(
    "div",
    { class: "film-head" },
    h("div", { class: "film-title" }, h("h1", {}, "Live"), about),
    status.pill,
  );
  const bar = h("div", { class: "submit-bar" }, summary, button);
  show("idle");
  meters.clear();
  const left = h("div", { class: "studio-stage" }, head, stage, figuresFold(meters));
  return h(
    "div",
    { class: "studio live" },
    left,
    h("aside", { class: "panel", "aria-label": "Settings" }, settings.element, bar),
  );
}

/** Folded on a phone, where the settings matter more. */
function figuresFold(meters: Meters): HTMLElement {
  const open = !matchMedia("(max-width: 720px)").matches;
  return h(
    "details",
    { class: "group live-figures", open },
    h("summary", {}, h("span", {}, "Figures")),
    meters.element,
  );
}

/** Call once the value is at rest: a slider passes many values. */
function settled(act: () => void): () => void {
  let timer = 0;
  return () => {
    clearTimeout(timer);
    timer = window.setTimeout(act, SETTLE_MS);
  };
}

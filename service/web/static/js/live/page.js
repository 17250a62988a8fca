/** The live page: one source, one stream, one screen, and what holds them together. */

import { draftHash } from "../draft.js";
import { acceptDrops } from "../dropzone.js";
import { h, icon } from "../dom.js";
import { announce, notify } from "../notices.js";
import { TITLES } from "./codecs.js";
import { createFigures } from "./figures.js";
import { createInvitation } from "./invitation.js";
import { createMeters } from "./meters.js";
import { createRecorder } from "./recorder.js";
import { createScreen } from "./screen.js";
import { createSettings } from "./settings.js";
import { openSource } from "./source.js";
import { createStatus } from "./status.js";
import { createStream } from "./stream.js";
import { createTransport } from "./transport.js";

const SETTLE_MS = 400;
const SIZES = [[320, 240], [640, 480], [1280, 720]];
const START = { camera: "Start the camera", screen: "Share the screen", file: "Play the video" };

/** @param {{method: object, draft: object}} scene @returns {{element}} */
export function createLivePage({ method, draft }) {
  const status = createStatus();
  const meters = createMeters();
  const screen = createScreen(() => recorder.stop());
  const recorder = createRecorder(screen.canvas, {
    ontick: (...parts) => transport.recorded(...parts),
    onended: () => (transport.recording = false),
    onsaved: (name) => announce(`Saved as ${name}.`),
    onfault: notify,
  });
  const settings = createSettings(method, draft, { onsource: changeSource, onframes: changeFrames, onpaint: changePaint, onwire: settled(() => stream?.renew()) });
  const invitation = createInvitation(settings.source.kinds, begin);
  const transport = createTransport({ screen, stage: () => stage, onrecord: record, onflip: () => settings.source.next() });
  const [about, note] = [h("p", {}), h("p", { class: "submit-note" })];
  const button = h("button", { type: "button", class: "button primary submit", onclick: () => (running() ? stop() : start()) });
  let [source, stream, figures, connection] = [null, null, null, null];
  let [turn, ticking, rate] = [0, 0, 0];

  // -- from source to stream

  const running = () => status.name !== "idle" && status.name !== "failed";

  function begin(kind) {
    settings.source.kind = kind;
    if (kind === "file") settings.source.pick();
    else start();
  }

  async function start() {
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
    } catch (problem) {
      if (mine === turn) halt(problem);
    }
  }

  function run(opened) {
    source = opened;
    transport.mirrored = source.selfie;
    settings.source.refresh(source).then(() => (transport.several = settings.source.several));
    if (stream) return stream.attach(source), onstate(connection);
    figures = createFigures();
    stream = createStream({ screen, figures, settings: settings.values, told: { onstate, onready, onmessage, onpicture } });
    ticking = setInterval(tick, 1000);
    stream.attach(source);
    stream.open();
  }

  /** End it all, and say how it went. */
  function stop() {
    const farewell = letGo();
    invitation.invite();
    show("idle");
    farewell?.then((stats) => stats && !running() && (note.textContent = `${stats.painted} of ${stats.received} frames were painted.`));
  }

  function halt(problem) {
    letGo();
    settings.problem(problem);
    invitation.complain(problem, start);
    show("failed");
  }

  function letGo() {
    turn += 1;
    recorder.stop();
    clearInterval(ticking);
    const farewell = stream?.close();
    source?.stop();
    [source, stream] = [null, null];
    screen.clear();
    return farewell;
  }

  // -- what the stream tells

  function onstate(state) {
    connection = state;
    if (state.name === "failed") halt(state.problem);
    else if (state.name === "waiting") show(state.why, state.until);
    else if (state.name !== "closed") show(state.name === "live" ? "starting" : state.name);
  }

  function onready({ send, receive, fps }) {
    rate = fps;
    meters.codecs(`${TITLES[send.codec]} up, ${TITLES[receive.codec]} down`);
  }

  function onpicture() {
    if (status.name === "starting") show("live");
  }

  function onmessage(message) {
    if (message.type === "stats" || message.type === "resolution") meters.heard(message);
    if (message.type === "params") settings.quiet();
    if (message.type === "error" && !settings.problem(message.problem)) notify({ ...message.problem, message: message.problem.detail });
    if (message.type === "replaced") notify({ title: "Another painter took over", message: "The one at work was lost; shapes and colours may jump once." });
  }

  function tick() {
    const second = figures.second();
    meters.show(second, figures, settings.values().fps);
    note.textContent = status.name === "live" && second.glassMs ? `${Math.round(second.fps)} fps · ${Math.round(second.glassMs)} ms` : "";
    about.textContent = source ? `${source.label} · ${screen.canvas.width} × ${screen.canvas.height}` : "";
  }

  // -- what the user changes

  function changeSource() {
    const { kind, file } = settings.source;
    if (running() || (kind === "file" && file)) start();
    else show(status.name);
  }

  function changeFrames() {
    source?.adjust(shape());
    if (stream && settings.values().fps !== rate) stream.renew();
  }

  function changePaint() {
    settings.quiet();
    stream?.change();
    history.replaceState(null, "", draftHash(settings.draft()));
  }

  /** The size and rate to ask of a camera. */
  function shape() {
    const { area, fps } = settings.values();
    const [width, height] = SIZES.find(([w, h]) => w * h >= area);
    return { width, height, fps };
  }

  function record() {
    if (recorder.recording) return recorder.stop();
    recorder.start();
    transport.recording = true;
  }

  // -- the look of it

  function show(name, until) {
    status.show(name, until);
    frame.setAttribute("aria-busy", String(status.waiting));
    button.textContent = running() ? "Stop" : START[settings.source.kind];
    button.classList.toggle("primary", !running());
    transport.running(name === "live" || recorder.recording);
    if (running()) return;
    note.textContent = "";
    about.textContent = "A camera, a screen or a video, painted as it runs.";
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
  const head = h("div", { class: "film-head" }, h("div", { class: "film-title" }, h("h1", {}, "Live"), about), status.pill);
  const bar = h("div", { class: "submit-bar" }, note, button);
  show("idle");
  meters.clear();
  return { element: h("div", { class: "studio live" }, h("div", { class: "studio-stage" }, head, stage, figuresFold(meters)), h("aside", { class: "panel", "aria-label": "Settings" }, settings.element, bar)) };
}

/** Folded on a phone, where the settings matter more. */
function figuresFold(meters) {
  const open = !matchMedia("(max-width: 720px)").matches;
  return h("details", { class: "group live-figures", open }, h("summary", {}, h("span", {}, "Figures")), meters.element);
}

/** Call once things have settled: a slider passes many values. */
function settled(act) {
  let timer = 0;
  return () => {
    clearTimeout(timer);
    timer = setTimeout(act, SETTLE_MS);
  };
}

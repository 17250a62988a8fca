/** One live session after another: the user's source, stream and recorder, and their state as signals. */

import { signal } from "@preact/signals";
import { asProblem, Problem } from "../api/api";
import { type ColourScheme, schemeOf } from "../forms/colour-scheme";
import { type Draft, draftHash } from "../forms/draft";
import { announce, notify, notifyOf } from "../ui/notices";
import { pixelsOf } from "../ui/palette";
import { TITLES } from "./codecs";
import { createFigures, type Figures, type Second } from "./figures";
import type { Painted } from "./meters";
import { createRecorder } from "./recorder";
import { Screen } from "./screen";
import { type Choice, Settings } from "./settings";
import { Sound } from "./sound";
import { SoundSender } from "./sound-sender";
import { openSource, type Source } from "./source";
import { SourceChoice } from "./source-choice";
import { isRunning, type Status } from "./status";
import { createStream, type Stream } from "./stream";
import type { Recorded } from "./transport";
import type { ConnectionState, Incoming, Ready, Shape, SourceKind, Stats } from "./types";

const SETTLE_MS = 400;
/** How often the hues of the source are counted, and the longest side of the picture in which they are. */
const HUES_EVERY_S = 3;
const HUES_SIDE_PX = 160;
const SIZES: [number, number][] = [
  [320, 240],
  [640, 480],
  [1280, 720],
];

export class Live {
  readonly status = signal<Status>({ name: "idle", until: 0 });
  /** Whether the card with the ways to begin is shown. */
  readonly inviting = signal(true);
  /** Why the last session did not begin, or ended. */
  readonly problem = signal<Problem | null>(null);
  readonly recorded = signal<Recorded | null>(null);
  readonly history = signal<readonly Second[]>([]);
  readonly dropShare = signal(0);
  readonly painted = signal<Painted | null>(null);
  readonly codecs = signal("");
  /** Below the settings: rate and delay, or the figures of the session that has ended. */
  readonly summary = signal("");
  /** What is painted. */
  readonly about = signal("");
  /** The colour scheme of what is painted; null: not known. */
  readonly scene = signal<ColourScheme | null>(null);

  readonly screen = new Screen(() => this.recorder.stop());
  readonly choice = new SourceChoice(() => this.changeSource());
  readonly settings: Settings;
  readonly sound = new Sound();
  readonly sender = new SoundSender((message) => this.stream?.sendSound(message), notify);
  private readonly recorder = createRecorder(this.screen.canvas, () => this.sound.tracks, {
    ontick: (seconds, bytes) => {
      this.recorded.value = { seconds, bytes };
    },
    onended: () => {
      this.recorded.value = null;
    },
    onsaved: (name) => announce(`Saved as ${name}.`),
    onfault: notify,
  });
  private source: Source | null = null;
  private stream: Stream | null = null;
  private figures: Figures | null = null;
  private connection: ConnectionState | null = null;
  private turn = 0;
  private ticking = 0;
  private seconds = 0;
  private rate = 0;

  constructor(choice: Choice, draft: Draft) {
    this.settings = new Settings(choice, draft, {
      onframes: () => this.changeFrames(),
      onpaint: () => this.changePaint(),
      onwire: settled(() => this.stream?.renew()),
    });
    document.addEventListener("visibilitychange", () => {
      const { name } = this.status.peek();
      if (document.hidden && name === "live") this.show("paused");
      else if (!document.hidden && name === "paused") this.show("live");
    });
    window.addEventListener("pagehide", () => this.running && this.stop());
  }

  private get running(): boolean {
    return isRunning(this.status.peek());
  }

  private show(name: Status["name"], until = 0): void {
    this.status.value = { name, until };
    if (!this.running) this.summary.value = this.about.value = "";
  }

  // -- from source to stream

  begin(kind: SourceKind): void {
    this.choice.kind.value = kind;
    if (kind === "file") this.choice.pick();
    else this.start();
  }

  async start(): Promise<void> {
    const kind = this.choice.kind.peek();
    if (kind === "file" && !this.choice.file.peek()) return this.choice.pick();
    const mine = ++this.turn;
    this.source?.stop();
    this.source = null;
    this.inviting.value = false;
    this.show(kind === "file" ? "opening" : "asking");
    try {
      const opened = await openSource(
        kind,
        { ...this.choice.wishes(), ...this.shape(), sound: this.sound.on.peek() },
        () => this.stop(),
      );
      if (mine === this.turn) this.run(opened);
      else opened.stop();
    } catch (error) {
      if (mine === this.turn) this.halt(asProblem(error));
    }
  }

  private run(opened: Source): void {
    this.source = opened;
    this.screen.mirrored.value = opened.selfie;
    this.choice.refresh(opened);
    this.takeSound(opened);
    if (this.stream) {
      this.stream.attach(opened);
      if (this.connection) this.onstate(this.connection);
      return;
    }
    this.figures = createFigures();
    this.stream = createStream({
      screen: this.screen,
      figures: this.figures,
      settings: () => this.settings.values(),
      events: {
        onstate: (state) => this.onstate(state),
        onready: (ready) => this.onready(ready),
        onmessage: (message) => this.onmessage(message),
        onpicture: () => {
          if (this.status.peek().name === "starting") this.show("live");
        },
      },
    });
    this.ticking = window.setInterval(() => this.tick(), 1000);
    this.stream.attach(opened);
    this.stream.open();
  }

  /** End the session, and report its figures. */
  stop(): void {
    const farewell = this.endSession();
    this.problem.value = null;
    this.inviting.value = true;
    this.show("idle");
    farewell?.then((stats) => {
      if (stats && !this.running) this.summary.value = `${stats.painted} of ${stats.received} frames were painted.`;
    });
  }

  private halt(problem: Problem): void {
    this.endSession();
    this.settings.problem(problem);
    this.problem.value = problem;
    this.inviting.value = true;
    this.show("failed");
  }

  private endSession(): Promise<Stats | null> | undefined {
    this.turn += 1;
    this.recorder.stop();
    clearInterval(this.ticking);
    const farewell = this.stream?.close();
    this.source?.stop();
    this.sender.detach();
    this.sound.detach();
    this.source = null;
    this.stream = null;
    this.screen.clear();
    return farewell;
  }

  // -- events of the stream

  private onstate(state: ConnectionState): void {
    this.connection = state;
    if (state.name === "failed") this.halt(state.problem);
    else if (state.name === "waiting") this.show(state.why, state.until);
    else if (state.name !== "closed") this.show(state.name === "live" ? "starting" : state.name);
  }

  private onready({ send, receive, fps }: Ready): void {
    this.rate = fps;
    this.codecs.value = `${TITLES[send.codec]} up, ${TITLES[receive.codec]} down`;
  }

  private onmessage(message: Incoming): void {
    if (message.type === "stats") this.painted.value = message;
    if (message.type === "resolution") this.painted.value = { ...this.painted.peek(), ...message };
    if (message.type === "params") this.settings.quiet();
    if (message.type === "error") {
      const problem = new Problem(message.problem);
      if (!this.settings.problem(problem)) notify(problem);
    }
    if (message.type === "replaced") {
      notifyOf({
        title: "Another worker took over",
        message: "The previous one was lost; shapes and colours may jump once.",
      });
    }
  }

  private tick(): void {
    if (!this.figures) return;
    const second = this.figures.second();
    this.history.value = [...this.figures.history];
    this.dropShare.value = this.figures.dropShare();
    this.sound.follow(second.glassMs);
    const { width, height } = this.screen.size.peek();
    const shown = this.status.peek().name === "live" && second.glassMs;
    this.summary.value = shown ? `${Math.round(second.fps)} fps · ${Math.round(shown)} ms` : "";
    this.about.value = this.source ? `${this.source.label} · ${width} × ${height}` : "";
    if (this.seconds++ % HUES_EVERY_S === 0) this.countHues();
  }

  private async countHues(): Promise<void> {
    const video = this.source?.video;
    if (!video?.videoWidth) return;
    const pixels = await pixelsOf(video, HUES_SIDE_PX).catch(() => null); // a video between two frames
    if (pixels) this.scene.value = schemeOf([pixels]);
  }

  // -- changes by the user

  private changeSource(): void {
    const file = this.choice.kind.peek() !== "file" || this.choice.file.peek();
    if (this.running || (this.choice.kind.peek() === "file" && file)) this.start();
  }

  private changeFrames(): void {
    this.source?.adjust(this.shape());
    if (this.stream && this.settings.values().fps !== this.rate) this.stream.renew();
  }

  private changePaint(): void {
    this.settings.quiet();
    this.stream?.change();
    history.replaceState(null, "", draftHash(this.settings.draft()));
  }

  /** The size and rate to ask of a camera. */
  private shape(): Shape {
    const { area, fps } = this.settings.values();
    const [width, height] = SIZES.find(([w, h]) => w * h >= area) ?? [1280, 720];
    return { width, height, fps };
  }

  /** Turn the sound of recordings on or off. A screen that is shared without its sound has to be shared again. */
  toggleSound(): void {
    const { on } = this.sound;
    on.value = !on.peek();
    const { source } = this;
    if (!source) return;
    const silent = source.kind === "screen" && !(source.video.srcObject as MediaStream).getAudioTracks().length;
    if (on.peek() && silent) this.start();
    else this.takeSound(source);
  }

  private takeSound(source: Source): void {
    this.sender.detach();
    this.sound.attach(source).then(
      () => this.sender.attach(this.sound.track),
      (error) => {
        this.sound.on.value = false;
        notify(error);
      },
    );
  }

  /** Let viewers hear the sound, which is taken if it is not, or end that. */
  toggleSending(): void {
    const { on } = this.sender;
    on.value = !(on.peek() && this.sound.on.peek());
    if (on.peek() && !this.sound.on.peek()) this.toggleSound();
    else this.sender.attach(this.sound.track);
  }

  record(): void {
    if (this.recorder.recording) this.recorder.stop();
    else {
      this.recorder.start();
      this.recorded.value = { seconds: 0, bytes: 0 };
    }
  }
}

/** Call once the value is at rest: a slider passes many values. */
function settled(act: () => void): () => void {
  let timer = 0;
  return () => {
    clearTimeout(timer);
    timer = window.setTimeout(act, SETTLE_MS);
  };
}

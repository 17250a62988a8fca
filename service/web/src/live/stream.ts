/** The path of a frame: captured, encoded, sent, painted by the service, received, decoded, shown beside its original. */

import type { Inputs } from "../api/schemas";
import { createGrabber, fitSize, followFrames, type Grab } from "./capture";
import { type Offer, offer } from "./codecs";
import { createConnection, readLiveInfo } from "./connection";
import { createDecoder, type Decoder } from "./decode";
import { createEncoder, type Encoder } from "./encode";
import type { Figures } from "./figures";
import type { Screen } from "./screen";
import type { Source } from "./source";
import type {
  ConnectionState,
  Hello,
  Incoming,
  IncomingFrame,
  LiveInfo,
  LiveSettings,
  OutgoingFrame,
  Ready,
  Size,
  Stats,
} from "./types";
import { pack, unpack } from "./wire";

/** Originals kept until their answers come. Cameras have few buffers: none may be kept for long. */
const MOST_KEPT = 6;
/** Limits of unanswered frames above which the network counts as slow: in seconds of the frame rate, and as a least number. */
const MOST_UNANSWERED_S = 0.5;
const LEAST_UNANSWERED = 4;
/** If no answer comes at all, a frame is sent this often nevertheless. */
const PROBE_MS = 500;
const SMALL_BYTES = 16_384;
/** Sound is not sent while more than this waits for the network: it would come too late. */
const MOST_SOUND_BACKLOG_BYTES = 262_144;
const CHANGE_EVERY_MS = 60;

export interface StreamOptions {
  screen: Screen;
  figures: Figures;
  /** The present settings. */
  settings(): LiveSettings;
  events: StreamEvents;
}

interface StreamEvents {
  onstate(state: ConnectionState): void;
  onready(message: Ready): void;
  onmessage(message: Incoming): void;
  onpicture(): void;
}

export interface Stream {
  /** Take frames from this source from now on. */
  attach(source: Source): void;
  open(): void;
  /** Send the present parameters and inputs. */
  change(): void;
  /** Agree anew on rate and codecs, if other ones are wanted. */
  renew(): void;
  /** Send a packet of sound, if the session is connected. */
  sendSound(message: Uint8Array<ArrayBuffer>): void;
  /** Resolves to the figures of the whole session, or null. */
  close(): Promise<Stats | null>;
}

export function createStream({ screen, figures, settings, events }: StreamOptions): Stream {
  const kept = new Map<number, VideoFrame>();
  const connection = createConnection({ hello, onready, onmessage, onframe, refused, onstate: events.onstate });
  const change = throttled(sendParams, CHANGE_EVERY_MS);
  let source: Source | null = null;
  let watcher: { close(): void } | null = null;
  let grab: Grab | null = null;
  let encoder: Encoder | null = null;
  let decoder: Decoder | null = null;
  let service: LiveInfo | null = null;
  let ready: Ready | null = null;
  let size: Size | null = null;
  let sequence = 0;
  let answered = 0;
  let lastBytes = 0;
  let lastSent = 0;
  let lastUs = 0;
  let faults = 0;
  let imagesOnly = false;
  let sentWishes = "";
  let agreedTerms = "";
  let agreedMethod = "";

  // -- opening

  async function hello(info: LiveInfo | null): Promise<Hello> {
    const known = info ?? service ?? (await readLiveInfo());
    service = known;
    const { method, params, filter, prefer, fps, quality } = settings();
    const rate = Math.min(fps, known.limits.fps);
    const shape = { ...measure(), fps: rate };
    size = shape;
    const codecs = await codecsFor(shape, known);
    sentWishes = wishes();
    agreedTerms = terms();
    agreedMethod = method;
    const painting = { method, params, inputs: givenInputs(), filter, prefer };
    return { type: "hello", ...painting, ...shape, ...codecs, quality };
  }

  async function codecsFor(shape: Size & { fps: number }, known: LiveInfo): Promise<Offer> {
    if (imagesOnly) return { send: ["jpeg"], receive: ["jpeg"] };
    return offer(shape, known, settings().codec);
  }

  const playing = (): Source => {
    if (!source) throw new Error("The stream has no source.");
    return source;
  };
  const measure = () => fitSize(playing().video, settings().area, service?.limits.width ?? Infinity);
  const givenInputs = () => Object.fromEntries(Object.entries(settings().inputs).filter(([, id]) => id)) as Inputs;
  const wishes = () => JSON.stringify([settings().params, settings().inputs, settings().filter]);
  const terms = () => {
    const { method, prefer, fps, codec, quality } = settings();
    return JSON.stringify([method, prefer, fps, codec, quality]);
  };

  function onready(message: Ready): void {
    ready = message;
    answered = sequence;
    stopCoding();
    decoder = makeDecoder(message);
    events.onready(message);
    if (sentWishes !== wishes()) sendParams();
  }

  const makeDecoder = (message: Ready): Decoder =>
    createDecoder(message.receive, { onpicture, onlost: askKeyFrame, onfault: decoderFault });

  function sendParams(): void {
    const { method, params, inputs, filter } = settings();
    if (method !== agreedMethod) return; // the next hello brings them
    sentWishes = wishes();
    connection.sendMessage({ type: "params", params, inputs, filter });
  }

  // -- frames out

  function capture(timeMs: number): void {
    if (!connection.live) {
      screen.preview(playing().video, measure());
      return;
    }
    figures.captured();
    if (behind()) figures.skipped();
    else encodeFrame(timeMs);
  }

  function encodeFrame(timeMs: number): void {
    const now = fitEncoder();
    if (!now || !grab) return;
    const timeUs = Math.max(lastUs + 1, Math.round(timeMs * 1000));
    lastUs = timeUs;
    const picture = grab(now, timeUs);
    keep(timeUs, picture);
    attempt(() => encoder?.encode(picture, timeUs), encoderFault);
  }

  /** Whether a frame sent now would only wait, here or on the way. */
  function behind(): boolean {
    if (encoder?.busy || connection.backlog > Math.max(SMALL_BYTES, lastBytes)) return true;
    const most = Math.max(LEAST_UNANSWERED, MOST_UNANSWERED_S * settings().fps);
    return sequence - answered > most && performance.now() - lastSent < PROBE_MS;
  }

  /** The size to encode at. It changes when a phone is rotated or another size is chosen; the stream continues. */
  function fitEncoder(): Size | null {
    const now = measure();
    if (!ready) return null;
    if (encoder && size && now.width === size.width && now.height === size.height) return size;
    size = now;
    screen.resize(now);
    encoder?.close();
    encoder = createEncoder(ready.send.codec, { ...now, fps: ready.fps }, { onpayload, onfault: encoderFault });
    return now;
  }

  function onpayload(frame: OutgoingFrame): void {
    if (!connection.live) return;
    sequence += 1;
    const message = pack(frame, sequence);
    connection.send(message);
    lastBytes = message.byteLength;
    lastSent = performance.now();
    figures.sent(lastBytes);
  }

  function keep(timeUs: number, picture: VideoFrame | HTMLCanvasElement): void {
    if (!("close" in picture)) return;
    kept.set(timeUs, picture);
    const oldest = kept.keys().next().value;
    if (kept.size > MOST_KEPT && oldest !== undefined) release(oldest);
  }

  /** Close all kept originals up to that time. */
  function release(untilUs: number): void {
    for (const [timeUs, frame] of kept) {
      if (timeUs > untilUs) return;
      frame.close();
      kept.delete(timeUs);
    }
  }

  // -- pictures in

  function onframe(buffer: ArrayBuffer): void {
    const frame = unpack(buffer);
    answered = Math.max(answered, frame.sequence);
    attempt(() => decoder?.decode(frame), decoderFault);
  }

  function onpicture(picture: CanvasImageSource, { timeUs, serverMs, bytes }: IncomingFrame): void {
    screen.paint(picture, kept.get(timeUs) ?? playing().video);
    release(timeUs);
    figures.shown({ glassMs: performance.now() - timeUs / 1000, serverMs, bytes });
    events.onpicture();
  }

  function onmessage(message: Incoming): void {
    if (message.type === "stats") figures.heard(message);
    if (message.type === "keyframe") encoder?.wantKey();
    events.onmessage(message);
  }

  // -- faults of a codec: one more try with a key frame (and plain RGB: some cameras have odd formats), then images

  const askKeyFrame = () => connection.sendMessage({ type: "keyframe" });

  function encoderFault(error: unknown): void {
    encoder?.close();
    encoder = null;
    if (mayTryAgain(error)) grab = createGrabber(playing().video, false);
    else connection.renew();
  }

  function decoderFault(error: unknown): void {
    decoder?.close();
    decoder = ready && makeDecoder(ready);
    if (mayTryAgain(error)) askKeyFrame();
    else connection.renew();
  }

  /** Whether to try the same codec once more. */
  function mayTryAgain(error: unknown): boolean {
    console.info("Impasto live: a codec failed.", error);
    faults += 1;
    imagesOnly = imagesOnly || faults > 1;
    return !imagesOnly;
  }

  function refused(): boolean {
    const video = ready?.send.codec !== "jpeg";
    imagesOnly = imagesOnly || video;
    return video;
  }

  function stopCoding(): void {
    encoder?.close();
    decoder?.close();
    encoder = null;
    decoder = null;
    release(Infinity);
  }

  return {
    open: connection.open,
    change,
    renew() {
      if (agreedTerms === terms()) return;
      imagesOnly = false; // a codec that has failed may be tried again
      faults = 0;
      connection.renew();
    },
    attach(next) {
      watcher?.close();
      source = next;
      grab = createGrabber(next.video);
      watcher = followFrames(next.video, () => settings().fps, capture);
    },
    sendSound: (message) =>
      connection.live && connection.backlog < MOST_SOUND_BACKLOG_BYTES && connection.send(message),
    close() {
      watcher?.close();
      stopCoding();
      return connection.close();
    },
  };
}

/** A codec that has just failed throws before its error callback is called. */
function attempt(act: () => void, onfault: (error: unknown) => void): void {
  try {
    act();
  } catch (error) {
    onfault(error);
  }
}

/** Call at once, then at most every `ms`, and always once more after the last call. */
function throttled(act: () => void, ms: number): () => void {
  let timer = 0;
  let wanted = false;
  function run(): void {
    timer = 0;
    if (!wanted) return;
    wanted = false;
    act();
    timer = window.setTimeout(run, ms);
  }
  return () => {
    wanted = true;
    if (!timer) run();
  };
}

/** The way of a frame: captured, encoded, sent; painted elsewhere; received, decoded, shown beside the frame it was made from. */

import { createGrabber, fit, watchFrames } from "./capture.js";
import { offer } from "./codecs.js";
import { createConnection, lookAround } from "./connection.js";
import { createDecoder } from "./decode.js";
import { createEncoder } from "./encode.js";
import { pack, unpack } from "./wire.js";

/** Originals kept until their answers come. Cameras own few buffers: none may be held for long. */
const MOST_HELD = 6;
/** Frames under way beyond which the network holds them: as seconds of the rate, and at least so many. */
const MOST_UNDER_WAY_S = 0.5;
const LEAST_UNDER_WAY = 4;
/** If nothing at all comes back, a frame is sent this often nevertheless. */
const KNOCK_MS = 500;
const SMALL_BYTES = 16_384;
const CHANGE_EVERY_MS = 60;

/**
 * @param {object} parts
 * @param {object} parts.screen where pictures are shown @param {object} parts.figures where they are counted
 * @param {function(): object} parts.settings as they are now: method, params, inputs, fps, area, codec, quality, adaptive
 * @param {object} parts.told {onstate(state), onready(ready), onmessage(message), onpicture()}
 * @returns {{attach(source), open(), change(), renew(), close(): Promise}}
 */
export function createStream({ screen, figures, settings, told }) {
  const held = new Map();
  const connection = createConnection({ hello, onready, onmessage, onframe, refused, onstate: told.onstate });
  const change = throttled(tell, CHANGE_EVERY_MS);
  let [source, watcher, grab, encoder, decoder, service, ready] = Array(7).fill(null);
  let [sequence, answered, lastBytes, lastSent, lastUs, faults] = Array(6).fill(0);
  let stillsOnly = false;
  let size = null;
  let said = "";
  let agreed = "";

  // -- opening

  async function hello(room) {
    service = room ?? service ?? (await lookAround());
    const { method, params, fps, codec, quality, adaptive } = settings();
    const rate = Math.min(fps, service.limits.fps);
    size = measure();
    const codecs = await offer({ ...size, fps: rate }, service, stillsOnly ? "jpeg" : codec);
    if (stillsOnly) Object.assign(codecs, { send: ["jpeg"], receive: ["jpeg"] });
    said = wishes();
    agreed = terms();
    return { type: "hello", method, params, inputs: given(), ...size, fps: rate, ...codecs, quality, adaptive };
  }

  const measure = () => fit(source.video, settings().area, service?.limits.width ?? Infinity);
  const given = () => Object.fromEntries(Object.entries(settings().inputs).filter(([, id]) => id));
  const wishes = () => JSON.stringify([settings().params, settings().inputs]);
  const terms = () => JSON.stringify([settings().fps, settings().codec, settings().quality, settings().adaptive]);

  function onready(message) {
    ready = message;
    answered = sequence;
    stopCoding();
    decoder = createDecoder(message.receive, { onpicture, onlost: askKey, onfault: decoderFault });
    told.onready(message);
    if (said !== wishes()) tell();
  }

  function tell() {
    const { params, inputs } = settings();
    said = wishes();
    connection.say({ type: "params", params, inputs });
  }

  // -- frames out

  function capture(timeMs) {
    if (!connection.live) return screen.preview(source.video, measure());
    figures.captured();
    if (behind()) return figures.skipped();
    fitEncoder();
    const timeUs = (lastUs = Math.max(lastUs + 1, Math.round(timeMs * 1000)));
    const frame = grab(size, timeUs);
    hold(timeUs, frame);
    attempt(() => encoder.encode(frame, timeUs), encoderFault);
  }

  /** Whether a frame sent now would only wait, here or on the way. */
  function behind() {
    if (encoder?.busy || connection.backlog > Math.max(SMALL_BYTES, lastBytes)) return true;
    const most = Math.max(LEAST_UNDER_WAY, MOST_UNDER_WAY_S * settings().fps);
    return sequence - answered > most && performance.now() - lastSent < KNOCK_MS;
  }

  /** A phone was turned, or another size was chosen: the stream goes on at that size. */
  function fitEncoder() {
    const now = measure();
    if (encoder && now.width === size.width && now.height === size.height) return;
    size = now;
    screen.resize(size);
    encoder?.close();
    encoder = createEncoder(ready.send.codec, { ...size, fps: ready.fps }, { onpayload, onfault: encoderFault });
  }

  function onpayload({ payload, ...header }) {
    if (!connection.live) return;
    sequence += 1;
    const message = pack({ ...header, sequence }, payload);
    connection.send(message);
    [lastBytes, lastSent] = [message.byteLength, performance.now()];
    figures.sent(lastBytes);
  }

  function hold(timeUs, frame) {
    if (!frame.close) return;
    held.set(timeUs, frame);
    if (held.size > MOST_HELD) release(held.keys().next().value);
  }

  /** Let go of all originals up to that time. */
  function release(untilUs) {
    for (const [timeUs, frame] of held) {
      if (timeUs > untilUs) return;
      frame.close();
      held.delete(timeUs);
    }
  }

  // -- pictures in

  function onframe(buffer) {
    const header = unpack(buffer);
    answered = Math.max(answered, header.sequence);
    attempt(() => decoder?.decode({ ...header, bytes: buffer.byteLength }), decoderFault);
  }

  function onpicture(picture, { timeUs, serverMs, bytes }) {
    screen.paint(picture, held.get(timeUs) ?? source.video);
    release(timeUs);
    figures.shown({ glassMs: performance.now() - timeUs / 1000, serverMs, bytes });
    told.onpicture();
  }

  function onmessage(message) {
    if (message.type === "stats") figures.heard(message);
    if (message.type === "keyframe") encoder?.wantKey();
    told.onmessage(message);
  }

  // -- faults of coding: once more with a key frame (and plain pictures: some cameras have odd ones), then stills

  const askKey = () => connection.say({ type: "keyframe" });

  function encoderFault(error) {
    encoder?.close();
    encoder = null;
    if (again(error)) grab = createGrabber(source.video, false);
    else connection.renew();
  }

  function decoderFault(error) {
    decoder.close();
    decoder = createDecoder(ready.receive, { onpicture, onlost: askKey, onfault: decoderFault });
    if (again(error)) askKey();
    else connection.renew();
  }

  /** Whether to try the same codec once more. */
  function again(error) {
    console.info("Impasto live: a codec failed.", error);
    faults += 1;
    stillsOnly = stillsOnly || faults > 1;
    return !stillsOnly;
  }

  function refused() {
    const video = ready?.send.codec !== "jpeg";
    stillsOnly = stillsOnly || video;
    return video;
  }

  function stopCoding() {
    encoder?.close();
    decoder?.close();
    encoder = decoder = null;
    release(Infinity);
  }

  return {
    open: connection.open,
    change,
    /** Agree anew on rate and codecs, if others are wished for; one that has failed may be tried again. */
    renew() {
      if (agreed === terms()) return;
      stillsOnly = false;
      faults = 0;
      connection.renew();
    },
    /** Take frames from this source from now on. */
    attach(next) {
      watcher?.close();
      source = next;
      grab = createGrabber(next.video);
      watcher = watchFrames(next.video, () => settings().fps, capture);
    },
    /** Resolves to the figures of the whole session, or null. */
    close() {
      watcher?.close();
      stopCoding();
      return connection.close();
    },
  };
}

/** A codec that has just failed throws before it has said so. */
function attempt(act, onfault) {
  try {
    act();
  } catch (error) {
    onfault(error);
  }
}

/** Call at once, then at most every `ms`, and always once more after the last call. */
function throttled(act, ms) {
  let timer = 0;
  let wanted = false;
  function run() {
    timer = 0;
    if (!wanted) return;
    wanted = false;
    act();
    timer = setTimeout(run, ms);
  }
  return () => {
    wanted = true;
    if (!timer) run();
  };
}

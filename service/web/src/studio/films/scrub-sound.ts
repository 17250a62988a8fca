/** Sound while the pointer drags along a film: short pieces of the clip's sound, where the pointer is. */

import * as api from "../../api/api";
import type { Asset } from "../../api/schemas";
import { announce } from "../../ui/notices";
import { audible } from "./playback";

/** Length of a piece, and of its fades; a new piece begins at most so often. Seconds. */
const GRAIN_S = 0.1;
const FADE_S = 0.008;
const EVERY_S = 0.045;
/** The whole sound of a clip is decoded, at half of the usual rate: 10 MB a minute. */
const RATE = 24_000;
const MOST_S = 600;
const MOST_BYTES = 200 << 20;
/** Clips whose sound is kept. */
const KEPT = 3;

type Sound = AudioBuffer | null;

/** Why dragging along a clip is silent; empty: it is not. */
export function silence({ info, size_bytes: bytes }: Asset): string {
  if (!info.has_audio) return "The clip has no sound.";
  const long = (info.duration_s ?? 0) > MOST_S || bytes > MOST_BYTES;
  return long ? `Dragging is silent: the clip is longer than ${MOST_S / 60} minutes, or larger than 200 MB.` : "";
}

const sounds = new Map<string, Promise<Sound>>();
let context: AudioContext | null = null;
/** The piece that was begun last, and when, in the context's seconds. */
let piece: { node: AudioBufferSourceNode; gain: GainNode; began: number } | null = null;
let asked = 0;
/** The timer of a piece that came too early. */
let waiting = 0;

/** Let the sound of a clip be heard at a frame of it, if sound is on; the first time once the clip is decoded. */
export async function hear(asset: Asset, frame: number): Promise<void> {
  if (!audible.peek() || silence(asset)) return;
  context ??= new AudioContext();
  if (context.state === "suspended") context.resume().catch(() => {});
  const wish = ++asked;
  const sound = await soundOf(asset);
  if (sound && wish === asked) play(context, sound, frame / (asset.info.fps || 25));
}

function play(on: AudioContext, sound: AudioBuffer, second: number): void {
  const now = on.currentTime;
  clearTimeout(waiting);
  const early = piece ? piece.began + EVERY_S - now : 0;
  if (early > 0) {
    waiting = window.setTimeout(() => play(on, sound, second), 1000 * early);
    return;
  }
  if (piece) {
    piece.gain.gain.cancelScheduledValues(now);
    piece.gain.gain.setTargetAtTime(0, now, FADE_S / 3);
    piece.node.stop(now + 2 * FADE_S);
  }
  const node = new AudioBufferSourceNode(on, { buffer: sound });
  const gain = new GainNode(on, { gain: 0 });
  node.connect(gain).connect(on.destination);
  gain.gain.setValueAtTime(0, now);
  gain.gain.linearRampToValueAtTime(1, now + FADE_S);
  gain.gain.setValueAtTime(1, now + GRAIN_S - FADE_S);
  gain.gain.linearRampToValueAtTime(0, now + GRAIN_S);
  node.start(now, Math.min(second, Math.max(0, sound.duration - GRAIN_S)), GRAIN_S);
  piece = { node, gain, began: now };
}

function soundOf(asset: Asset): Promise<Sound> {
  const known = sounds.get(asset.id) ?? decode(asset);
  sounds.delete(asset.id);
  sounds.set(asset.id, known);
  for (const old of sounds.keys()) if (sounds.size > KEPT) sounds.delete(old);
  return known;
}

/** The sound of a clip; null, which is said once, if this browser cannot decode it. */
async function decode({ id, filename }: Asset): Promise<Sound> {
  try {
    const bytes = await (await api.request(api.paths.content(id))).arrayBuffer();
    return await new OfflineAudioContext(1, 1, RATE).decodeAudioData(bytes);
  } catch (error) {
    console.info("Impasto: the sound of a clip cannot be decoded.", error);
    announce(`Dragging along ${filename} is silent: this browser cannot decode its sound.`);
    return null;
  }
}

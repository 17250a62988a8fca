/** Sends the sound of a live source to the viewers of the session: Opus packets with the times of their recording. */

import { signal } from "@preact/signals";
import { Problem } from "../api/api";
import { packSound } from "./wire";

const CODEC = {
  codec: "opus",
  sampleRate: 48_000,
  numberOfChannels: 2,
  bitrate: 96_000,
  opus: { frameDuration: 20_000 },
} as const satisfies AudioEncoderConfig;
/** The clock of the sound is set anew when it is off by more, microseconds. */
const STEP_US = 100_000;

/** Whether this browser can send sound. Only Chromium hands out the samples of a track. */
export const canSendSound = (): boolean => "AudioEncoder" in globalThis && "MediaStreamTrackProcessor" in globalThis;

export class SoundSender {
  /** Whether viewers hear the sound. */
  readonly on = signal(false);
  private encoder: AudioEncoder | null = null;
  private reader: ReadableStreamDefaultReader<AudioData> | null = null;
  private sequence = 0;

  constructor(
    private readonly send: (message: Uint8Array<ArrayBuffer>) => void,
    private readonly onfault: (problem: Problem) => void,
  ) {}

  /** Send this track from now on, if viewers are to hear it. */
  attach(track: MediaStreamTrack | undefined): void {
    this.detach();
    if (!this.on.peek() || !track) return;
    const encoder = new AudioEncoder({
      output: (chunk) => {
        const payload = new Uint8Array(chunk.byteLength);
        chunk.copyTo(payload);
        this.sequence += 1;
        this.send(packSound(payload, CODEC.numberOfChannels, Math.round(chunk.timestamp), this.sequence));
      },
      error: (error) => this.fail(error),
    });
    encoder.configure(CODEC);
    this.encoder = encoder;
    const reader = new MediaStreamTrackProcessor({ track }).readable.getReader();
    this.reader = reader;
    this.pump(reader, encoder).catch((error) => this.fail(error));
  }

  private fail(error: DOMException): void {
    this.detach();
    this.on.value = false;
    this.onfault(fault(error));
  }

  detach(): void {
    this.reader?.cancel().catch(() => {});
    if (this.encoder && this.encoder.state !== "closed") this.encoder.close();
    this.reader = null;
    this.encoder = null;
  }

  /** Samples follow each other without gaps; their time is that of `performance.now()`, as for frames. */
  private async pump(reader: ReadableStreamDefaultReader<AudioData>, encoder: AudioEncoder): Promise<void> {
    let timeUs = 0;
    for (;;) {
      const { done, value: samples } = await reader.read();
      if (done || encoder.state !== "configured") {
        samples?.close();
        return;
      }
      const nowUs = performance.now() * 1000 - samples.duration;
      if (Math.abs(nowUs - timeUs) > STEP_US) timeUs = nowUs;
      const timed = retimed(samples, Math.max(0, Math.round(timeUs)));
      timeUs += samples.duration;
      encoder.encode(timed);
      timed.close();
    }
  }
}

/** The same samples at another time. */
function retimed(samples: AudioData, timestamp: number): AudioData {
  const { numberOfFrames, numberOfChannels, sampleRate } = samples;
  const data = new Float32Array(numberOfFrames * CODEC.numberOfChannels);
  for (let channel = 0; channel < CODEC.numberOfChannels; channel++)
    samples.copyTo(data.subarray(channel * numberOfFrames), {
      planeIndex: Math.min(channel, numberOfChannels - 1),
      format: "f32-planar",
    });
  samples.close();
  const { numberOfChannels: channels } = CODEC;
  return new AudioData({
    format: "f32-planar",
    sampleRate,
    numberOfFrames,
    numberOfChannels: channels,
    timestamp,
    data,
  });
}

const fault = (error: DOMException): Problem =>
  new Problem({
    code: error.name,
    title: "The sound is not sent any more",
    detail: "This browser could not encode it. The picture goes on.",
    remedy: "Turn the sound for viewers on again.",
  });

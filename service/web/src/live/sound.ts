/** The sound of a live source: for recordings, later by the delay of the painted picture; for viewers, as it comes. */

import { signal } from "@preact/signals";
import { Problem } from "../api/api";
import type { Source } from "./source";

/** The longest delay that can be made up for, and how far it may be off before it is corrected, seconds. */
const MOST_DELAY_S = 3;
const STEP_S = 0.02;
/** Time of a correction: a faster one is heard as a change of pitch. */
const GLIDE_S = 0.5;

export class Sound {
  /** Whether the sound is taken: recordings have it then. */
  readonly on = signal(false);
  private context: AudioContext | null = null;
  private delay: DelayNode | null = null;
  private output: MediaStreamAudioDestinationNode | null = null;
  private present: MediaStreamAudioDestinationNode | null = null;
  private input: AudioNode | null = null;
  private microphone: MediaStream | null = null;
  private readonly files = new WeakMap<HTMLVideoElement, AudioNode>();

  /** The delayed sound; none while there is none. */
  get tracks(): readonly MediaStreamTrack[] {
    return this.input ? (this.output?.stream.getAudioTracks() ?? []) : [];
  }

  /** The sound without delay; undefined while there is none. */
  get track(): MediaStreamTrack | undefined {
    return this.input ? this.present?.stream.getAudioTracks()[0] : undefined;
  }

  /**
   * Take the sound of a source from now on: of the file, of the shared tab, or of the microphone beside a camera. Throws a
   * Problem if it has none, or may not be used.
   */
  async attach(source: Source): Promise<void> {
    this.detach();
    if (!this.on.peek()) return;
    const context = this.open();
    this.input = await this.inputOf(source, context);
    this.input.connect(this.delay as DelayNode);
    this.input.connect(this.present as AudioNode);
  }

  /** The delay of the picture, from camera to painting, ms; null: unknown. */
  follow(glassMs: number | null): void {
    const { context, delay } = this;
    if (!context || !delay || glassMs === null) return;
    const wanted = Math.min(MOST_DELAY_S, glassMs / 1000);
    if (Math.abs(delay.delayTime.value - wanted) > STEP_S)
      delay.delayTime.setTargetAtTime(wanted, context.currentTime, GLIDE_S / 3);
  }

  /** Release the microphone. */
  detach(): void {
    this.input?.disconnect();
    this.input = null;
    for (const track of this.microphone?.getTracks() ?? []) track.stop();
    this.microphone = null;
  }

  private open(): AudioContext {
    if (!this.context) {
      this.context = new AudioContext({ sampleRate: 48_000 }); // the rate of Opus
      this.delay = new DelayNode(this.context, { maxDelayTime: MOST_DELAY_S });
      this.output = this.context.createMediaStreamDestination();
      this.delay.connect(this.output);
      this.present = this.context.createMediaStreamDestination();
    }
    this.context.resume().catch(() => {});
    return this.context;
  }

  private async inputOf({ kind, video }: Source, context: AudioContext): Promise<AudioNode> {
    if (kind === "file") return this.fileSound(video, context);
    if (kind === "screen") {
      const shared = (video.srcObject as MediaStream).getAudioTracks();
      if (!shared.length) throw silentScreen();
      return context.createMediaStreamSource(new MediaStream(shared));
    }
    try {
      const plain = { echoCancellation: false, noiseSuppression: false, autoGainControl: false };
      this.microphone = await navigator.mediaDevices.getUserMedia({ audio: plain });
    } catch (error) {
      throw noMicrophone(error);
    }
    return context.createMediaStreamSource(this.microphone);
  }

  /** An element can be taken into a context once only. It is no longer muted then, but heard in recordings only. */
  private fileSound(video: HTMLVideoElement, context: AudioContext): AudioNode {
    const known = this.files.get(video) ?? context.createMediaElementSource(video);
    this.files.set(video, known);
    video.muted = false;
    return known;
  }
}

const silentScreen = (): Problem =>
  new Problem({
    code: "no-sound",
    title: "The screen is shared without its sound",
    detail: "Recordings have no sound.",
    remedy: "Start again, choose a tab, and tick “Also share tab audio”; few systems share the sound of windows.",
  });

const noMicrophone = (error: unknown): Problem =>
  new Problem({
    code: error instanceof Error ? error.name : "no-sound",
    title: "No microphone",
    detail: "This page may not use a microphone, or there is none. Recordings have no sound.",
    remedy: "Allow it at the sign beside the address, then turn the sound on again.",
  });

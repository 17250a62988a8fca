/** Plays the sound of a watched session together with its pictures: a painting is later than its sound. */

/** Share of a new measurement in the delay of the pictures. */
const SMOOTHING = 0.05;
/** A larger change of the delay is another session, or another clock, ms. */
const JUMP_MS = 500;
/** Packets follow each other without gaps unless their time is off by more, seconds. */
const STEP_S = 0.08;
/** Time to decode and to begin, seconds. */
const LEAST_LEAD_S = 0.03;
const SAMPLE_RATE = 48_000;

export class ViewSound {
  private context: AudioContext | null = null;
  private decoder: AudioDecoder | null = null;
  /** From the time of a picture, on the sender's clock, to its time on the screen, on ours. */
  private delayMs: number | null = null;
  /** The time of the context at which all that is scheduled ends. */
  private until = 0;

  /** `onwaiting`: whether the browser waits for a gesture of the user before it plays. */
  constructor(private readonly onwaiting: (waiting: boolean) => void) {}

  /** A picture of this time of the sender is shown now. */
  shown(timeUs: number): void {
    const delayMs = performance.now() - timeUs / 1000;
    const before = this.delayMs ?? delayMs;
    this.delayMs = Math.abs(delayMs - before) > JUMP_MS ? delayMs : before + SMOOTHING * (delayMs - before);
  }

  /** A packet of sound has come. */
  hear({ payload, timeUs }: { payload: Uint8Array; timeUs: number }): void {
    if (!("AudioDecoder" in globalThis)) return;
    const context = this.opened();
    this.onwaiting(context.state !== "running");
    if (context.state !== "running" || this.delayMs === null) return;
    if (this.decoder?.state !== "configured") this.decoder = this.makeDecoder(context);
    this.decoder.decode(new EncodedAudioChunk({ type: "key", timestamp: timeUs, data: payload }));
  }

  /** Call in a gesture of the user. */
  start(): void {
    this.opened()
      .resume()
      .then(
        () => this.onwaiting(false),
        () => {},
      );
  }

  private opened(): AudioContext {
    this.context ??= new AudioContext({ sampleRate: SAMPLE_RATE });
    return this.context;
  }

  private makeDecoder(context: AudioContext): AudioDecoder {
    const decoder = new AudioDecoder({
      output: (samples) => this.play(context, samples),
      error: (error) => console.info("Impasto live: no sound.", error), // the next packet opens another one
    });
    decoder.configure({ codec: "opus", sampleRate: SAMPLE_RATE, numberOfChannels: 2 });
    return decoder;
  }

  private play(context: AudioContext, samples: AudioData): void {
    const buffer = context.createBuffer(samples.numberOfChannels, samples.numberOfFrames, samples.sampleRate);
    for (let channel = 0; channel < samples.numberOfChannels; channel++)
      samples.copyTo(buffer.getChannelData(channel), { planeIndex: channel, format: "f32-planar" });
    const atMs = samples.timestamp / 1000 + (this.delayMs ?? 0);
    samples.close();
    const least = context.currentTime + LEAST_LEAD_S;
    const wanted = Math.max(least, context.currentTime + (atMs - performance.now()) / 1000);
    const follows = this.until >= context.currentTime && Math.abs(wanted - this.until) < STEP_S;
    const source = new AudioBufferSourceNode(context, { buffer });
    source.connect(context.destination);
    source.start(follows ? this.until : wanted);
    this.until = (follows ? this.until : wanted) + buffer.duration;
  }
}

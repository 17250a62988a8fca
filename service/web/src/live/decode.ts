/** Payloads to pictures: a video decoder of the browser, or one image per frame. */

import type { IncomingFrame, Receive } from "./types";

const MOST_AT_ONCE = 3;

export interface DecoderEvents {
  /** May use the picture until it returns. */
  onpicture(picture: CanvasImageSource, frame: IncomingFrame): void;
  /** A key frame is needed. */
  onlost(): void;
  /** This decoder cannot be used any more. */
  onfault(error: unknown): void;
}

export interface Decoder {
  decode(frame: IncomingFrame): void;
  close(): void;
}

export const createDecoder = (chosen: Receive, events: DecoderEvents): Decoder =>
  chosen.webcodecs ? videoDecoder(chosen.webcodecs, events) : imageDecoder(chosen.codec, events);

function videoDecoder(codec: string, { onpicture, onlost, onfault }: DecoderEvents): Decoder {
  const frames = new Map<number, IncomingFrame>();
  let keyframeNeeded = true;
  let asked = false;
  const decoder = new VideoDecoder({ output, error: onfault });
  decoder.configure({ codec, optimizeForLatency: true });

  function output(picture: VideoFrame): void {
    const frame = frames.get(picture.timestamp);
    for (const sequence of frames.keys()) if (sequence <= picture.timestamp) frames.delete(sequence);
    if (frame) onpicture(picture, frame);
    picture.close();
  }

  function decode(frame: IncomingFrame): void {
    if (keyframeNeeded && !frame.key) {
      if (!asked) onlost();
      asked = true;
      return;
    }
    keyframeNeeded = false;
    frames.set(frame.sequence, frame);
    const type = frame.key ? "key" : "delta";
    decoder.decode(new EncodedVideoChunk({ type, timestamp: frame.sequence, data: frame.payload }));
  }

  function close(): void {
    if (decoder.state !== "closed") decoder.close();
  }

  return { decode, close };
}

function imageDecoder(codec: string, { onpicture, onfault }: DecoderEvents): Decoder {
  let open = true;
  let running = 0;
  let shown = -1;

  async function decode(frame: IncomingFrame): Promise<void> {
    if (running >= MOST_AT_ONCE) return;
    running += 1;
    try {
      const picture = await createImageBitmap(new Blob([frame.payload], { type: `image/${codec}` }));
      if (open && frame.sequence > shown) {
        shown = frame.sequence;
        onpicture(picture, frame);
      }
      picture.close();
    } catch (error) {
      if (open) onfault(error);
    }
    running -= 1;
  }

  return {
    decode: (frame) => void decode(frame),
    close() {
      open = false;
    },
  };
}

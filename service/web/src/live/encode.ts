/** Pictures to payloads: a video encoder of the browser, or one JPEG per frame. */

import { encoderConfig } from "./codecs";
import type { OutgoingFrame, Shape } from "./types";

/** A picture that is still being encoded when the next comes means that this machine is behind. */
const MOST_AT_ONCE = 2;
const JPEG_QUALITY = 0.88;

export interface EncoderEvents {
  onpayload(frame: OutgoingFrame): void;
  onfault(error: unknown): void;
}

export interface Encoder {
  readonly busy: boolean;
  /** Does not keep the picture. */
  encode(picture: VideoFrame | HTMLCanvasElement, timeUs: number): void;
  /** Make the next frame a key frame. */
  wantKey(): void;
  close(): void;
}

/** `codec`: "h264", "vp8" or "jpeg"; `shape` of the pictures. */
export const createEncoder = (codec: string, shape: Shape, events: EncoderEvents): Encoder =>
  codec === "jpeg" ? jpegEncoder(shape, events) : videoEncoder(codec, shape, events);

function videoEncoder(codec: string, shape: Shape, { onpayload, onfault }: EncoderEvents): Encoder {
  const { width, height } = shape;
  let key = true;
  const encoder = new VideoEncoder({ output, error: onfault });
  encoder.configure(encoderConfig(codec, shape));

  function output(chunk: EncodedVideoChunk): void {
    const payload = new Uint8Array(chunk.byteLength);
    chunk.copyTo(payload);
    onpayload({ payload, key: chunk.type === "key", width, height, timeUs: chunk.timestamp });
  }

  return {
    get busy() {
      return encoder.encodeQueueSize >= MOST_AT_ONCE;
    },
    encode(picture) {
      encoder.encode(picture as VideoFrame, { keyFrame: key });
      key = false;
    },
    wantKey() {
      key = true;
    },
    close() {
      if (encoder.state !== "closed") encoder.close();
    },
  };
}

type Canvas = OffscreenCanvas | HTMLCanvasElement;

function jpegEncoder({ width, height }: Shape, { onpayload, onfault }: EncoderEvents): Encoder {
  const offscreen = "OffscreenCanvas" in globalThis;
  const canvas: Canvas = offscreen
    ? new OffscreenCanvas(width, height)
    : Object.assign(document.createElement("canvas"), { width, height });
  const context = canvas.getContext("2d", { alpha: false }) as CanvasRenderingContext2D | null;
  let open = true;
  let running = 0;
  let turn = Promise.resolve();

  async function encode(picture: CanvasImageSource, timeUs: number): Promise<void> {
    context?.drawImage(picture, 0, 0, width, height);
    const made = jpeg(canvas);
    const before = turn;
    running += 1;
    turn = (async () => {
      const payload = await made;
      await before;
      if (open) onpayload({ payload, key: true, width, height, timeUs });
    })();
    await turn.catch((error) => open && onfault(error));
    running -= 1;
  }

  return {
    get busy() {
      return running >= MOST_AT_ONCE;
    },
    encode: (picture, timeUs) => void encode(picture, timeUs),
    wantKey() {},
    close() {
      open = false;
    },
  };
}

async function jpeg(canvas: Canvas): Promise<Uint8Array<ArrayBuffer>> {
  const type = "image/jpeg";
  const blob =
    "convertToBlob" in canvas
      ? await canvas.convertToBlob({ type, quality: JPEG_QUALITY })
      : await new Promise<Blob | null>((made) => canvas.toBlob(made, type, JPEG_QUALITY));
  if (!blob) throw new DOMException("The browser made no JPEG.", "EncodingError");
  return new Uint8Array(await blob.arrayBuffer());
}

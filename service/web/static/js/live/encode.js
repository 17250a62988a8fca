/** Pictures to payloads: a video encoder of the browser, or a JPEG each. */

import { encoderConfig } from "./codecs.js";

/** A picture that is still being encoded when the next comes means that this machine is behind. */
const MOST_AT_ONCE = 2;
const JPEG_QUALITY = 0.88;

/**
 * @param {string} codec "h264", "vp8" or "jpeg"
 * @param {{width: number, height: number, fps: number}} shape of the pictures
 * @param {{onpayload({payload, key, width, height, timeUs}), onfault(error)}} told
 * @returns {{busy: boolean, encode(frame: VideoFrame|HTMLCanvasElement, timeUs: number), wantKey(), close()}}
 *     `encode` does not keep the frame
 */
export const createEncoder = (codec, shape, told) => (codec === "jpeg" ? stills(shape, told) : video(codec, shape, told));

function video(codec, shape, { onpayload, onfault }) {
  const { width, height } = shape;
  let key = true;
  const encoder = new VideoEncoder({ output, error: onfault });
  encoder.configure(encoderConfig(codec, shape));

  function output(chunk) {
    const payload = new Uint8Array(chunk.byteLength);
    chunk.copyTo(payload);
    onpayload({ payload, key: chunk.type === "key", width, height, timeUs: chunk.timestamp });
  }

  return {
    get busy() {
      return encoder.encodeQueueSize >= MOST_AT_ONCE;
    },
    encode(frame) {
      encoder.encode(frame, { keyFrame: key });
      key = false;
    },
    wantKey: () => (key = true),
    close: () => encoder.state === "closed" || encoder.close(),
  };
}

function stills({ width, height }, { onpayload, onfault }) {
  const canvas = globalThis.OffscreenCanvas ? new OffscreenCanvas(width, height) : Object.assign(document.createElement("canvas"), { width, height });
  const context = canvas.getContext("2d", { alpha: false });
  let open = true;
  let atWork = 0;
  let turn = Promise.resolve();

  async function encode(frame, timeUs) {
    context.drawImage(frame, 0, 0, width, height);
    const made = jpeg(canvas);
    const before = turn;
    atWork += 1;
    turn = (async () => {
      const payload = await made;
      await before;
      if (open) onpayload({ payload, key: true, width, height, timeUs });
    })();
    await turn.catch((error) => open && onfault(error));
    atWork -= 1;
  }

  return {
    get busy() {
      return atWork >= MOST_AT_ONCE;
    },
    encode,
    wantKey: () => {},
    close: () => (open = false),
  };
}

async function jpeg(canvas) {
  const type = "image/jpeg";
  const blob = await (canvas.convertToBlob?.({ type, quality: JPEG_QUALITY }) ?? new Promise((made) => canvas.toBlob(made, type, JPEG_QUALITY)));
  return new Uint8Array(await blob.arrayBuffer());
}

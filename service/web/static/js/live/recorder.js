/** The painting, recorded to a file as it is shown. */

import { Problem } from "../api.js";

/** Best first; MP4 plays everywhere, but few browsers write it. */
const TYPES = ["video/mp4;codecs=avc1.42E01F", "video/mp4;codecs=avc1.4D0028", "video/webm;codecs=vp9", "video/webm;codecs=vp8", "video/webm"];
const BITS_PER_S = 8_000_000;
const PIECE_MS = 1000;
const TICK_MS = 500;

/** Whether this browser can record at all. */
export const canRecord = () => Boolean(globalThis.MediaRecorder && HTMLCanvasElement.prototype.captureStream);

/**
 * @param {HTMLCanvasElement} canvas
 * @param {{ontick(seconds, bytes), onended(), onsaved(name), onfault(problem)}} told
 * @returns {{recording: boolean, start(), stop()}} `stop` saves what there is
 */
export function createRecorder(canvas, { ontick, onended, onsaved, onfault }) {
  let recorder = null;

  function start() {
    const mimeType = TYPES.find((type) => MediaRecorder.isTypeSupported(type));
    const stream = canvas.captureStream();
    const pieces = [];
    const began = performance.now();
    recorder = new MediaRecorder(stream, { mimeType, videoBitsPerSecond: BITS_PER_S });
    const mine = recorder;
    const tick = () => ontick((performance.now() - began) / 1000, pieces.reduce((sum, piece) => sum + piece.size, 0));
    const ticking = setInterval(tick, TICK_MS);
    mine.addEventListener("dataavailable", ({ data }) => data.size && pieces.push(data));
    mine.addEventListener("error", ({ error }) => onfault(broken(error)));
    mine.addEventListener("stop", () => {
      stream.getTracks().forEach((track) => track.stop());
      clearInterval(ticking);
      recorder = null;
      onended();
      finish(new Blob(pieces, { type: mine.mimeType }));
    });
    mine.start(PIECE_MS);
  }

  function finish(blob) {
    if (!blob.size) return onfault(broken());
    const name = fileName(blob.type);
    save(blob, name);
    onsaved(name);
  }

  return {
    get recording() {
      return recorder !== null;
    },
    start,
    stop: () => recorder?.state === "recording" && recorder.stop(),
  };
}

/** "impasto-2026-11-21-15.04.05.webm", in local time. */
function fileName(type) {
  const now = new Date(Date.now() - new Date().getTimezoneOffset() * 60_000).toISOString();
  return `impasto-${now.slice(0, 10)}-${now.slice(11, 19).replaceAll(":", ".")}.${type.includes("mp4") ? "mp4" : "webm"}`;
}

function save(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

const broken = (error) =>
  new Problem({ code: "recording", title: "The recording failed", detail: error?.message || "Nothing was recorded.", remedy: "Record again; in a window of its own if this one is often hidden." });

/** Records the displayed painting to a file. */

import { Problem, saveFile } from "../api/api";

/** Best first; MP4 plays everywhere, but few browsers write it. */
const WITH_SOUND = [
  "video/mp4;codecs=avc1.42E01F,mp4a.40.2",
  "video/mp4;codecs=avc1.42E01F,opus",
  "video/webm;codecs=vp9,opus",
  "video/webm;codecs=vp8,opus",
  "video/webm",
];
const SILENT = [
  "video/mp4;codecs=avc1.42E01F",
  "video/mp4;codecs=avc1.4D0028",
  "video/webm;codecs=vp9",
  "video/webm;codecs=vp8",
  "video/webm",
];
const BITS_PER_S = 8_000_000;
const PIECE_MS = 1000;
const TICK_MS = 500;

/** Whether this browser can record at all. */
export const canRecord = (): boolean => "MediaRecorder" in globalThis && "captureStream" in HTMLCanvasElement.prototype;

export interface RecorderEvents {
  ontick(seconds: number, bytes: number): void;
  onended(): void;
  onsaved(name: string): void;
  onfault(problem: Problem): void;
}

export interface Recorder {
  readonly recording: boolean;
  start(): void;
  /** Ends the recording and saves it. */
  stop(): void;
}

/** `sound`: tracks that are recorded with the picture. */
export function createRecorder(
  canvas: HTMLCanvasElement,
  sound: () => readonly MediaStreamTrack[],
  { ontick, onended, onsaved, onfault }: RecorderEvents,
): Recorder {
  let recorder: MediaRecorder | null = null;

  function start(): void {
    const heard = sound();
    const types = heard.length ? WITH_SOUND : SILENT;
    const mimeType = types.find((type) => MediaRecorder.isTypeSupported(type)) ?? "";
    const pictures = canvas.captureStream();
    const stream = new MediaStream([...pictures.getVideoTracks(), ...heard]);
    const pieces: Blob[] = [];
    const began = performance.now();
    const mine = new MediaRecorder(stream, { mimeType, videoBitsPerSecond: BITS_PER_S });
    recorder = mine;
    const size = () => pieces.reduce((sum, piece) => sum + piece.size, 0);
    const ticking = setInterval(() => ontick((performance.now() - began) / 1000, size()), TICK_MS);
    mine.addEventListener("dataavailable", ({ data }) => data.size && pieces.push(data));
    mine.addEventListener("error", () => onfault(broken()));
    mine.addEventListener("stop", () => {
      for (const track of pictures.getTracks()) track.stop();
      clearInterval(ticking);
      recorder = null;
      onended();
      finish(new Blob(pieces, { type: mine.mimeType }));
    });
    mine.start(PIECE_MS);
  }

  function finish(blob: Blob): void {
    if (!blob.size) {
      onfault(broken());
      return;
    }
    const name = fileName(blob.type);
    saveFile(blob, name);
    onsaved(name);
  }

  return {
    get recording() {
      return recorder !== null;
    },
    start,
    stop() {
      if (recorder?.state === "recording") recorder.stop();
    },
  };
}

/** "impasto-2026-11-21-15.04.05.webm", in local time. */
function fileName(type: string): string {
  const now = new Date(Date.now() - new Date().getTimezoneOffset() * 60_000).toISOString();
  return `impasto-${now.slice(0, 10)}-${now.slice(11, 19).replaceAll(":", ".")}.${type.includes("mp4") ? "mp4" : "webm"}`;
}

const broken = (): Problem =>
  new Problem({
    code: "recording",
    title: "The recording failed",
    detail: "Nothing was recorded.",
    remedy: "Record again; in a window of its own if this one is often hidden.",
  });

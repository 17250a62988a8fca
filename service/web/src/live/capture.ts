/** Frames of a playing video, at the wanted rate and size. */

import type { Size } from "./types";

/** The size nearest to `area` pixels with the video's shape: never larger than the video or `side`, and even. */
export function fitSize({ videoWidth, videoHeight }: HTMLVideoElement, area: number, side: number): Size {
  const scale = Math.min(1, Math.sqrt(area / (videoWidth * videoHeight)), side / Math.max(videoWidth, videoHeight));
  return { width: even(videoWidth * scale), height: even(videoHeight * scale) };
}

const even = (length: number): number => Math.max(16, 2 * Math.round(length / 2));

/** A capture time further away from now belongs to another clock, and is replaced by the time of the call. */
const PLAUSIBLE_MS = 1000;
/** How much before its time a frame may come, in periods: cameras tick unevenly. */
const EARLY = 0.4;

/**
 * Call `onframe(timeMs)` when the video shows a new frame, at most `fps()` times a second, and never while the tab is
 * hidden. `timeMs`: time of capture, on the clock of `performance.now()`.
 */
export function followFrames(
  video: HTMLVideoElement,
  fps: () => number,
  onframe: (timeMs: number) => void,
): { close(): void } {
  const byFrame = "requestVideoFrameCallback" in video;
  let pending = 0;
  let due = 0;

  function tick(now: number, about?: VideoFrameCallbackMetadata): void {
    pending = next();
    const period = 1000 / fps();
    if (document.hidden || video.paused || now < due - EARLY * period) return;
    due = Math.max(due, now - period) + period;
    onframe(captured(about, performance.now()));
  }

  const next = () => (byFrame ? video.requestVideoFrameCallback(tick) : requestAnimationFrame((now) => tick(now)));
  pending = next();
  return { close: () => (byFrame ? video.cancelVideoFrameCallback(pending) : cancelAnimationFrame(pending)) };
}

function captured(about: VideoFrameCallbackMetadata | undefined, now: number): number {
  const at = about?.captureTime ?? now;
  return at <= now && now - at < PLAUSIBLE_MS ? at : now;
}

/** Newer fields of VideoFrame that TypeScript's types lack. */
type Oriented = VideoFrame & { rotation?: number; flip?: boolean };

/** Whether an encoder can use the frame unchanged: it is upright, with square pixels. */
const plain = ({ rotation, flip, visibleRect }: Oriented, width: number, height: number): boolean =>
  !rotation && !flip && visibleRect?.width === width && visibleRect.height === height;

export type Grab = (size: Size, timestamp: number) => VideoFrame | HTMLCanvasElement;

/**
 * Makes pictures of a video's present frame, scaled. The caller closes a VideoFrame. `direct`: pass on the source's own
 * frames where they fit; else all are drawn anew, in plain RGB.
 */
export function createGrabber(video: HTMLVideoElement, direct = true): Grab {
  const canvas = document.createElement("canvas");
  const context = canvas.getContext("2d", { alpha: false });
  return ({ width, height }, timestamp) => {
    const hasFrames = "VideoFrame" in globalThis;
    const whole = direct && hasFrames && video.videoWidth === width && video.videoHeight === height;
    const frame = whole ? new VideoFrame(video, { timestamp }) : null;
    if (frame && plain(frame, width, height)) return frame;
    frame?.close();
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    context?.drawImage(video, 0, 0, width, height);
    return hasFrames ? new VideoFrame(canvas, { timestamp }) : canvas;
  };
}

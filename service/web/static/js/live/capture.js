/** Frames of a playing video, at the rate and size that are wanted. */

/** The size nearest to `area` pixels with the video's shape: never larger than the video or `side`, and even. */
export function fit({ videoWidth, videoHeight }, area, side) {
  const scale = Math.min(1, Math.sqrt(area / (videoWidth * videoHeight)), side / Math.max(videoWidth, videoHeight));
  return { width: even(videoWidth * scale), height: even(videoHeight * scale) };
}

const even = (length) => Math.max(16, 2 * Math.round(length / 2));

/** A capture time that is no such thing (a clock of its own) is worth no more than the time of the call. */
const PLAUSIBLE_MS = 1000;
/** How much before its time a frame may come, in periods: cameras tick unevenly. */
const EARLY = 0.4;

/**
 * Call `onframe(timeMs)` when the video shows a new frame, at most `fps()` times a second, and never while the tab is hidden.
 * `timeMs`: when it was captured, on the clock of `performance.now()`.
 * @returns {{close()}}
 */
export function watchFrames(video, fps, onframe) {
  const byFrame = "requestVideoFrameCallback" in video;
  let pending = 0;
  let due = 0;

  function tick(now, about) {
    pending = next();
    const period = 1000 / fps();
    if (document.hidden || video.paused || now < due - EARLY * period) return;
    due = Math.max(due, now - period) + period;
    onframe(captured(about, performance.now()));
  }

  const next = () => (byFrame ? video.requestVideoFrameCallback(tick) : requestAnimationFrame(tick));
  pending = next();
  return { close: () => (byFrame ? video.cancelVideoFrameCallback(pending) : cancelAnimationFrame(pending)) };
}

function captured(about, now) {
  const at = about?.captureTime ?? now;
  return at <= now && now - at < PLAUSIBLE_MS ? at : now;
}

/** Whether an encoder may take the frame as it is: upright, with square pixels. */
const plain = ({ rotation, flip, visibleRect }, width, height) => !rotation && !flip && visibleRect.width === width && visibleRect.height === height;

/**
 * Makes pictures of a video's present frame, scaled.
 * @param {boolean} direct pass on the source's own frames where they fit; else all are drawn anew, in plain RGB
 * @returns {function({width, height}, number): VideoFrame|HTMLCanvasElement} the caller closes a VideoFrame
 */
export function createGrabber(video, direct = true) {
  const canvas = document.createElement("canvas");
  const context = canvas.getContext("2d", { alpha: false });
  return ({ width, height }, timestamp) => {
    const whole = direct && globalThis.VideoFrame && video.videoWidth === width && video.videoHeight === height;
    const frame = whole ? new VideoFrame(video, { timestamp }) : null;
    if (frame && plain(frame, width, height)) return frame;
    frame?.close();
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    context.drawImage(video, 0, 0, width, height);
    return globalThis.VideoFrame ? new VideoFrame(canvas, { timestamp }) : canvas;
  };
}

/** Frames of a video or a film for the stage: decoded by the browser where it can, by the service where it cannot. */

import * as api from "../../api/api";
import { outputOf } from "../../api/formats";
import type { Asset, Job } from "../../api/schemas";
import { mayPlay } from "../../ui/stills";
import type { Size } from "../drawing/geometry";
import { seekTime } from "../state/timeline";

const SERVICE_SIDE_PX = 2048;

export interface FrameSource {
  /** Of the video, px. */
  readonly size: Size;
  /** The frame that `picture` shows now; -1 before the first. */
  readonly shown: number;
  readonly picture: CanvasImageSource | null;
  /** Show a frame; of several wishes the newest counts. */
  seek(frame: number): void;
  /** A copy of the shown frame, at the video's size. */
  copy(): Promise<ImageBitmap>;
  close(): void;
}

/** Frames that the browser can also play at their own speed. */
export interface FilmSource extends FrameSource {
  /**
   * Play from a frame on, `rate` times as fast as filmed, with or without sound; false if that is not possible. Wishes of
   * frames count again after `pause`.
   */
  play(from: number, rate?: number, sound?: boolean): boolean;
  pause(): void;
  /** The frame that is played now. */
  readonly now: number;
  /** Whether the browser can play it; else its frames can only be sought. */
  readonly plays: boolean;
  /** Whether it was played to its end. */
  readonly ended: boolean;
}

/** Where frames come from. */
interface Media {
  /** Of the video, px. */
  size: Size;
  fps: number;
  /** Address of the whole video; empty: the browser cannot play it. */
  video: string;
  /** Address of one frame as a picture. */
  still(frame: number): string;
  /** Whether the video is turned by its metadata. */
  turned: boolean;
}

/** `onshown` is called whenever another frame can be drawn. */
export function openFrames(asset: Asset, onshown: () => void): FilmSource {
  const media = {
    size: sizeOf(asset),
    fps: asset.info.fps || 25,
    video: mayPlay(asset) ? api.paths.content(asset.id) : "",
    still: (frame: number) => api.paths.frame(asset.id, frame, SERVICE_SIDE_PX),
    turned: Boolean(asset.info.rotation_deg),
  };
  return open(media, onshown);
}

/** Frames of a finished film, from 0; `of`: its video. */
export function openFilm(job: Job, of: Asset, onshown: () => void): FilmSource {
  const plays = outputOf(job.request.output?.format).shownAs === "video";
  const media = {
    size: sizeOf(of),
    fps: of.info.fps || 25,
    video: plays ? api.paths.result(job.id) : "",
    still: (frame: number) => api.url`/v1/jobs/${job.id}/frames/${frame}`,
    turned: false,
  };
  return open(media, onshown);
}

const open = (media: Media, onshown: () => void): FilmSource =>
  media.video ? browserFrames(media, onshown) : serviceFrames(media, onshown);

const COPY_TIMEOUT_MS = 20_000;

let copying: Promise<unknown> = Promise.resolve();

/**
 * A picture of any frame at the video's size, whichever the stage shows. One is made at a time: each takes a decoder of
 * its own, which has some 100 MB for 1080p.
 *
 * `wanted`: false once no caller waits for the frame; an AbortError is then thrown.
 */
export function copyFrame(asset: Asset, frame: number, wanted: () => boolean): Promise<ImageBitmap> {
  const made = copying.then(() => {
    if (!wanted()) throw aborted();
    return decodeFrame(asset, frame);
  });
  copying = made.catch(() => {});
  return made;
}

export const aborted = (): Error => new DOMException("It is not wanted any more.", "AbortError");

function decodeFrame(asset: Asset, frame: number): Promise<ImageBitmap> {
  return new Promise((resolve, reject) => {
    const problem = () => new api.Problem({ detail: `Frame ${frame + 1} cannot be read.`, remedy: "Try it again." });
    const timer = setTimeout(() => finish(Promise.reject(problem())), COPY_TIMEOUT_MS);
    const source = openFrames(asset, () => source.shown === frame && finish(source.copy()));
    const finish = (copied: Promise<ImageBitmap>) => {
      clearTimeout(timer);
      copied.then(resolve, reject).finally(() => source.close());
    };
    source.seek(frame);
  });
}

const sizeOf = (asset: Asset): Size => ({ width: asset.info.width ?? 16, height: asset.info.height ?? 9 });

function browserFrames(media: Media, onshown: () => void): FilmSource {
  const video = document.createElement("video");
  Object.assign(video, { muted: true, playsInline: true, preload: "auto" });
  const { fps } = media;
  let wanted = 0;
  let playing = false;
  let seeking = -1;
  let shown = -1;
  let fallback: FilmSource | null = null;
  /** The shown frame; null: the video itself is drawn. */
  let still: ImageBitmap | null = null;

  function next(): void {
    if (playing || seeking >= 0 || wanted === shown || video.readyState < 1) return;
    seeking = wanted;
    video.currentTime = seekTime(wanted, fps);
  }

  const takeStill = () =>
    arrived(video, media)
      .then(() => stillOf(video, media))
      .catch(() => null);

  video.addEventListener("loadedmetadata", () => (video.videoWidth ? next() : useService()));
  video.addEventListener("seeked", async () => {
    const frame = seeking;
    const taken = frame >= 0 && !playing ? await takeStill() : null;
    still?.close();
    still = playing ? null : taken;
    if (frame >= 0) shown = frame;
    seeking = -1;
    onshown();
    next();
  });
  video.addEventListener("error", () => video.hasAttribute("src") && useService());
  api.mediaUrl(media.video).then((url) => {
    video.src = url;
  }, useService);

  function useService(): void {
    if (fallback) return;
    fallback = serviceFrames(media, onshown);
    fallback.seek(wanted);
  }

  return {
    size: media.size,
    get shown() {
      if (playing) return this.now;
      return fallback ? fallback.shown : shown;
    },
    get picture() {
      if (fallback) return fallback.picture;
      return shown >= 0 ? (still ?? video) : null;
    },
    seek(frame) {
      wanted = frame;
      if (fallback) fallback.seek(frame);
      else next();
    },
    copy: () => (fallback ? fallback.copy() : createImageBitmap(still ?? video)),
    play(from, rate = 1, sound = false) {
      if (fallback || shown < 0) return false;
      playing = true;
      still?.close();
      still = null;
      if (this.now !== from) video.currentTime = seekTime(from, fps); // a seek to the same frame would delay it
      video.playbackRate = rate;
      video.muted = !sound;
      const silently = () => {
        video.muted = true; // a browser may refuse sound before the first click
        return video.play();
      };
      video
        .play()
        .catch(silently)
        .catch(() => {
          playing = false;
        });
      return true;
    },
    pause() {
      if (!playing) return;
      shown = this.now;
      playing = false;
      video.pause();
      next();
    },
    get now() {
      return Math.floor(video.currentTime * fps + 0.01);
    },
    get plays() {
      return !fallback;
    },
    get ended() {
      return video.ended;
    },
    close() {
      fallback?.close();
      shown = -1;
      still?.close();
      if (video.src.startsWith("blob:")) URL.revokeObjectURL(video.src);
      video.removeAttribute("src");
      video.load();
    },
  };
}

/** How long to wait for the frame of a seek, and how often to look for it. */
const ARRIVAL_MS = 1000;
const ARRIVAL_LOOK_MS = 20;
/** Addresses of videos whose frame times do not follow from frame numbers: they do not begin at 0, or their frame rate varies. */
const irregular = new Set<string>();

/**
 * Wait until the video has the frame of its present time. Irregular videos are waited for once, and afterwards taken as they
 * are.
 *
 * Chromium reports the end of a seek before the frame is there: after 22 of 1,800 seeks on a busy machine, the video still
 * had the former frame, or none.
 */
async function arrived(video: HTMLVideoElement, { video: address, fps }: Media): Promise<void> {
  const until = performance.now() + ARRIVAL_MS;
  while ("VideoFrame" in window && !irregular.has(address)) {
    const behind = framesBehind(video, fps);
    if (behind !== null && -0.25 < behind && behind < 1) return;
    if (performance.now() > until) {
      if (behind !== null) irregular.add(address);
      return;
    }
    await new Promise((done) => setTimeout(done, ARRIVAL_LOOK_MS));
  }
}

/** How many frames the video's picture is behind its present time; null: it has no picture. */
function framesBehind(video: HTMLVideoElement, fps: number): number | null {
  try {
    const frame = new VideoFrame(video);
    const behind = (video.currentTime - frame.timestamp / 1e6) * fps;
    frame.close();
    return behind;
  } catch {
    return null;
  }
}

/**
 * The video's present frame. Where the browser can, its pixels are copied: Chromium keeps every frame of a video that is drawn,
 * 9 MB each of 1080p.
 */
async function stillOf(video: HTMLVideoElement, { turned }: Media): Promise<ImageBitmap> {
  if (turned || !("VideoFrame" in window)) return createImageBitmap(video);
  const frame = new VideoFrame(video);
  try {
    const { width, height } = frame.visibleRect ?? { width: 0, height: 0 };
    if (width !== video.videoWidth || height !== video.videoHeight) return await createImageBitmap(video);
    const pixels = new Uint8ClampedArray(4 * width * height);
    await frame.copyTo(pixels, { format: "RGBA" });
    return await createImageBitmap(new ImageData(pixels, width, height));
  } finally {
    frame.close();
  }
}

function serviceFrames(media: Media, onshown: () => void): FilmSource {
  const controller = new AbortController();
  let wanted = -1;
  let shown = -1;
  let busy = false;
  let picture: ImageBitmap | null = null;

  async function next(): Promise<void> {
    if (busy || wanted === shown || controller.signal.aborted) return;
    busy = true;
    const frame = wanted;
    try {
      const answer = await api.request(media.still(frame), { signal: controller.signal });
      const decoded = await createImageBitmap(await answer.blob());
      picture?.close();
      picture = decoded;
      shown = frame;
      onshown();
    } catch (error) {
      if (!api.isAbort(error)) await new Promise((done) => setTimeout(done, 500));
    }
    busy = false;
    next();
  }

  return {
    size: media.size,
    get shown() {
      return shown;
    },
    play: () => false,
    pause() {},
    plays: false,
    ended: false,
    get now() {
      return shown;
    },
    get picture() {
      return picture;
    },
    seek(frame) {
      wanted = frame;
      next();
    },
    async copy() {
      if (!picture) throw new api.Problem({ detail: "The frame is not loaded yet.", remedy: "Wait a moment." });
      return createImageBitmap(picture);
    },
    close() {
      controller.abort();
      picture?.close();
      picture = null;
    },
  };
}

/** The source of the frames: a camera, the screen or a video file, each as a playing video element. */

import { Problem } from "../api/api";
import type { Shape, SourceKind } from "./types";

const FILE_REMEDY = "A video file works as well: drop one on the picture.";

export interface Source {
  kind: SourceKind;
  /** Playing. */
  video: HTMLVideoElement;
  label: string;
  deviceId: string;
  /** Whether people expect to see themselves mirrored. */
  selfie: boolean;
  /** Ask for another size and rate, which the source may not have. */
  adjust(shape: Shape): void;
  /** Release the camera. */
  stop(): void;
}

export interface SourceWishes extends Shape {
  deviceId?: string;
  facing?: string;
  file?: File | null;
  /** Whether the sound of a shared tab is wanted, too. */
  sound?: boolean;
}

/** `onended`: the user ended it outside of the page, or the device was disconnected. Throws a Problem with a remedy. */
export async function openSource(kind: SourceKind, wishes: SourceWishes, onended: () => void): Promise<Source> {
  if (kind === "file" && wishes.file) return openFile(wishes.file);
  if (!navigator.mediaDevices) throw insecure();
  if (kind === "screen" && !("getDisplayMedia" in navigator.mediaDevices)) throw noScreen();
  try {
    return await openStream(kind, await (kind === "screen" ? askScreen(wishes) : askCamera(wishes)), onended);
  } catch (error) {
    throw refusal(error, kind);
  }
}

/** The cameras; labels are empty until one was allowed. */
export async function listCameras(): Promise<{ deviceId: string; label: string }[]> {
  const devices = (await navigator.mediaDevices?.enumerateDevices().catch(() => [])) ?? [];
  return devices.filter((device) => device.kind === "videoinput").map(({ deviceId, label }) => ({ deviceId, label }));
}

function askCamera({ deviceId, facing, width, height, fps }: SourceWishes): Promise<MediaStream> {
  const which = deviceId ? { deviceId: { exact: deviceId } } : { facingMode: facing ?? "user" };
  const shape = { width: { ideal: width }, height: { ideal: height }, frameRate: { ideal: fps } };
  return navigator.mediaDevices.getUserMedia({ video: { ...which, ...shape } });
}

const askScreen = ({ fps, sound = false }: SourceWishes): Promise<MediaStream> =>
  navigator.mediaDevices.getDisplayMedia({ video: { frameRate: { ideal: fps } }, audio: sound });

async function openStream(kind: SourceKind, stream: MediaStream, onended: () => void): Promise<Source> {
  const [track] = stream.getVideoTracks();
  if (!track) throw new DOMException("The stream has no picture.", "NotFoundError");
  const video = createVideo();
  video.srcObject = stream;
  track.addEventListener("ended", onended);
  const stop = () => {
    track.removeEventListener("ended", onended);
    for (const each of stream.getTracks()) each.stop();
    video.remove();
  };
  const { facingMode, deviceId = "" } = track.getSettings();
  await playing(video).catch((error) => {
    stop();
    throw error;
  });
  const adjust = ({ width, height, fps }: Shape) => {
    track
      .applyConstraints({ width: { ideal: width }, height: { ideal: height }, frameRate: { ideal: fps } })
      .catch(() => {});
  };
  const selfie = kind === "camera" && facingMode !== "environment";
  return { kind, video, deviceId, label: kind === "screen" ? "Screen" : track.label, selfie, adjust, stop };
}

async function openFile(file: File): Promise<Source> {
  const video = createVideo();
  video.loop = true;
  video.src = URL.createObjectURL(file);
  const stop = () => {
    video.pause();
    URL.revokeObjectURL(video.src);
    video.remove();
  };
  await playing(video).catch(() => {
    stop();
    throw unplayable(file);
  });
  return { kind: "file", video, deviceId: "", label: file.name, selfie: false, adjust() {}, stop };
}

/** Phones stop videos that are not part of the page. */
function createVideo(): HTMLVideoElement {
  const video = Object.assign(document.createElement("video"), {
    className: "live-source",
    muted: true,
    playsInline: true,
    tabIndex: -1,
  });
  video.setAttribute("aria-hidden", "true");
  document.body.append(video);
  return video;
}

/** Resolves when the video plays and its size is known. */
async function playing(video: HTMLVideoElement): Promise<void> {
  const known = new Promise((resolve, reject) => {
    video.addEventListener("loadeddata", resolve, { once: true });
    video.addEventListener("error", () => reject(video.error), { once: true });
  });
  await Promise.all([known, video.play()]);
  if (!video.videoWidth) throw new DOMException("There is no picture in it.", "NotSupportedError");
}

// -- faults -----------------------------------------------------------------------------------------------------------

function insecure(): Problem {
  const local = `http://localhost${location.port && `:${location.port}`}/live`;
  return new Problem({
    code: "insecure",
    title: "No camera on this address",
    detail: `Browsers give cameras and screens to secure pages only, and ${location.origin} is not one.`,
    remedy: `Open it on the machine itself (${local}), or put the service behind HTTPS. ${FILE_REMEDY}`,
  });
}

const noScreen = (): Problem =>
  new Problem({
    code: "no-screen",
    title: "No screen to share",
    detail: "This browser cannot share its screen; phones mostly cannot.",
    remedy: "Use the camera or a video file.",
  });

const unplayable = (file: File): Problem =>
  new Problem({
    code: "unplayable",
    title: "This file does not play",
    detail: `The browser cannot play “${file.name}”.`,
    remedy: "Use MP4 (H.264) or WebM; the studio takes many more formats.",
  });

type Explanation = [title: string, detail: string, remedy: string];

const EXPLANATIONS: Record<string, Partial<Record<SourceKind, Explanation>>> = {
  NotAllowedError: {
    camera: [
      "The camera was not allowed",
      "This page may not use the camera.",
      `Allow it at the camera sign beside the address (on a phone: in the browser's settings for this site), then try again. ${FILE_REMEDY}`,
    ],
    screen: [
      "The screen was not shared",
      "No screen, window or tab was chosen.",
      "Try again and choose one; macOS also asks in its own settings, under Privacy.",
    ],
  },
  NotFoundError: {
    camera: [
      "No camera found",
      "This machine has no camera that the browser can see.",
      `Connect one and try again. ${FILE_REMEDY}`,
    ],
  },
  NotReadableError: {
    camera: ["The camera is busy", "Another program seems to use it.", "Close that program or tab, then try again."],
  },
  OverconstrainedError: {
    camera: ["That camera is gone", "The chosen camera is not connected any more.", "Choose another one."],
  },
};

/** A fault of getUserMedia or getDisplayMedia, with a remedy. */
function refusal(error: unknown, kind: SourceKind): Problem {
  const { name, message } = error instanceof Error ? error : new Error(String(error));
  const fallback: Explanation = [
    "That did not work",
    message || "The browser gave no reason.",
    `Try again. ${FILE_REMEDY}`,
  ];
  const [title, detail, remedy] = EXPLANATIONS[name]?.[kind] ?? fallback;
  return new Problem({ code: name, title, detail, remedy });
}

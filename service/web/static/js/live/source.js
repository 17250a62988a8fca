/** Where the frames come from: a camera, the screen or a video file, each as a playing video element. */

import { Problem } from "../api.js";
import { h } from "../dom.js";

const FILE_REMEDY = "A video file works as well: drop one on the picture.";

/**
 * @typedef {object} Source
 * @property {"camera"|"screen"|"file"} kind
 * @property {HTMLVideoElement} video playing
 * @property {string} label, deviceId
 * @property {boolean} selfie whether people expect to see themselves mirrored
 * @property {function({width, height, fps})} adjust asks for another size and rate, which it may not have
 * @property {function()} stop lets the camera go
 */

/**
 * @param {string} kind
 * @param {{deviceId?: string, facing?: string, width: number, height: number, fps: number, file?: File}} wishes
 * @param {function()} onended the user ended it outside of the page, or the device is gone
 * @returns {Promise<Source>} throws a Problem that says what to do
 */
export async function openSource(kind, wishes, onended) {
  if (kind === "file") return openFile(wishes.file);
  if (!navigator.mediaDevices) throw insecure();
  if (kind === "screen" && !navigator.mediaDevices.getDisplayMedia) throw noScreen();
  const stream = await (kind === "screen" ? askScreen(wishes) : askCamera(wishes)).catch((error) => {
    throw refusal(error, kind);
  });
  return ofStream(kind, stream, onended);
}

/** The cameras there are; labels are empty until one was allowed. */
export async function cameras() {
  const devices = (await navigator.mediaDevices?.enumerateDevices().catch(() => [])) ?? [];
  return devices.filter((device) => device.kind === "videoinput").map(({ deviceId, label }) => ({ deviceId, label }));
}

function askCamera({ deviceId, facing, width, height, fps }) {
  const which = deviceId ? { deviceId: { exact: deviceId } } : { facingMode: facing ?? "user" };
  return navigator.mediaDevices.getUserMedia({ video: { ...which, width: { ideal: width }, height: { ideal: height }, frameRate: { ideal: fps } } });
}

const askScreen = ({ fps }) => navigator.mediaDevices.getDisplayMedia({ video: { frameRate: { ideal: fps } }, audio: false });

async function ofStream(kind, stream, onended) {
  const [track] = stream.getVideoTracks();
  const video = element();
  video.srcObject = stream;
  track.addEventListener("ended", onended);
  const stop = () => {
    track.removeEventListener("ended", onended);
    stream.getTracks().forEach((each) => each.stop());
    video.remove();
  };
  const { facingMode, deviceId = "" } = track.getSettings();
  await playing(video).catch((error) => (stop(), Promise.reject(refusal(error, kind))));
  const adjust = ({ width, height, fps }) => track.applyConstraints({ width: { ideal: width }, height: { ideal: height }, frameRate: { ideal: fps } }).catch(() => {});
  const selfie = kind === "camera" && facingMode !== "environment";
  return { kind, video, deviceId, label: kind === "screen" ? "Screen" : track.label, selfie, adjust, stop };
}

async function openFile(file) {
  const video = element();
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
  return { kind: "file", video, deviceId: "", label: file.name, selfie: false, adjust: () => {}, stop };
}

/** Phones stop videos that are nowhere in the page. */
function element() {
  const video = h("video", { class: "live-source", muted: true, playsinline: "", tabindex: "-1", "aria-hidden": "true" });
  document.body.append(video);
  return video;
}

/** Until it plays and its size is known. */
async function playing(video) {
  const known = new Promise((resolve, reject) => {
    video.addEventListener("loadeddata", resolve, { once: true });
    video.addEventListener("error", () => reject(video.error), { once: true });
  });
  await Promise.all([known, video.play()]);
  if (!video.videoWidth) throw new DOMException("There is no picture in it.", "NotSupportedError");
}

// -- what can go wrong ------------------------------------------------------------------------------------------------

const insecure = () =>
  new Problem({
    code: "insecure",
    title: "No camera on this address",
    detail: `Browsers give cameras and screens to secure pages only, and ${location.origin} is not one.`,
    remedy: `Open it on the machine itself (http://localhost${location.port && `:${location.port}`}/live), or put the service behind HTTPS. ${FILE_REMEDY}`,
  });

const noScreen = () =>
  new Problem({ code: "no-screen", title: "No screen to share", detail: "This browser cannot share its screen; phones mostly cannot.", remedy: "Use the camera or a video file." });

const unplayable = (file) =>
  new Problem({
    code: "unplayable",
    title: "This file does not play",
    detail: `The browser cannot play “${file.name}”.`,
    remedy: "Use MP4 (H.264) or WebM; the studio takes many more formats.",
  });

const SAID = {
  NotAllowedError: {
    camera: ["The camera was not allowed", "This page may not use the camera.", `Allow it at the camera sign beside the address (on a phone: in the browser's settings for this site), then try again. ${FILE_REMEDY}`],
    screen: ["The screen was not shared", "No screen, window or tab was chosen.", "Try again and choose one; macOS also asks in its own settings, under Privacy."],
  },
  NotFoundError: { camera: ["No camera found", "This machine has no camera that the browser can see.", `Connect one and try again. ${FILE_REMEDY}`] },
  NotReadableError: { camera: ["The camera is busy", "Another program seems to use it.", "Close that program or tab, then try again."] },
  OverconstrainedError: { camera: ["That camera is gone", "The chosen camera is not connected any more.", "Choose another one."] },
};

/** A fault of getUserMedia or getDisplayMedia in words that help. */
function refusal(error, kind) {
  const [title, detail, remedy] = SAID[error.name]?.[kind] ?? ["That did not work", error.message || "The browser gave no reason.", `Try again. ${FILE_REMEDY}`];
  return new Problem({ code: error.name, title, detail, remedy });
}

/**
 * The live picture alone, without controls: for the browser source of OBS, or a second screen.
 *
 * Address: `?session=` (otherwise the newest session), `?fit=cover`, `?mirror`, `?quiet` (no messages), `?silent` (no sound),
 * and the API key as `#key=`, since a browser source has no place to type it in.
 */

import "../css/live-view.css";
import { byId } from "../ui/dom";
import { createDecoder, type Decoder } from "./decode";
import type { IncomingFrame, Receive } from "./types";
import { ViewSound } from "./view-sound";
import { dialView, isSound, unpack } from "./wire";

type ViewMessage =
  | { type: "ready"; receive: Receive; width: number; height: number }
  | { type: "waiting" }
  | { type: "error"; problem: { detail?: string; remedy?: string } };

const RETRY_MS = 2000;
const query = new URLSearchParams(location.search);
const key = new URLSearchParams(location.hash.slice(1)).get("key") ?? "";
const canvas = byId("picture") as HTMLCanvasElement;
const context = canvas.getContext("2d");
const status = byId("status");
const listen = byId("listen");
const sound = new ViewSound((waiting) => {
  listen.hidden = !waiting || query.has("quiet");
});

document.documentElement.dataset.fit = query.get("fit") ?? "contain";
if (query.has("mirror")) document.documentElement.dataset.mirror = "";

/** `why` is empty while a picture is shown. */
function show(why: string): void {
  status.textContent = query.has("quiet") ? "" : why;
  canvas.hidden = Boolean(why);
}

function connect(): void {
  const socket = dialView(query.get("session") ?? "", key, !query.has("silent"));
  const askKeyFrame = () => socket.readyState === WebSocket.OPEN && socket.send(JSON.stringify({ type: "keyframe" }));
  let decoder: Decoder | null = null;
  let fault = "";

  function paint(picture: CanvasImageSource, { width, height, timeUs }: IncomingFrame): void {
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    context?.drawImage(picture, 0, 0, width, height);
    show("");
    sound.shown(timeUs);
  }

  function open(receive: Receive): void {
    decoder?.close();
    decoder = createDecoder(receive, {
      onpicture: paint,
      onlost: askKeyFrame,
      onfault: () => {
        open(receive);
        askKeyFrame();
      },
    });
  }

  function hear(message: ViewMessage): void {
    if (message.type === "ready") open(message.receive);
    if (message.type === "waiting") show("No live session is running.");
    if (message.type === "error") fault = [message.problem.detail, message.problem.remedy].filter(Boolean).join(" ");
  }

  socket.addEventListener("message", ({ data }) => {
    if (typeof data === "string") hear(JSON.parse(data));
    else if (isSound(data)) sound.hear(unpack(data));
    else decoder?.decode(unpack(data));
  });
  socket.addEventListener("close", () => {
    decoder?.close();
    show(fault || "No connection to the service. If it requires a key, add #key= and the key to the address.");
    setTimeout(connect, RETRY_MS);
  });
}

listen.addEventListener("click", () => sound.start());
show("Connecting…");
connect();

/** The bytes and the address of docs/live.md: a header of 32 bytes before each frame, both ways, and before sound. */

import { authorisation } from "../api/api";
import { under } from "../api/base";
import type { IncomingFrame, OutgoingFrame } from "./types";

const PROTOCOL = "impasto.live.1";
const VERSION = 1;
const HEADER_BYTES = 32;
const KEY = 1;
const SOUND = 2;

/** A frame as one message. */
export function pack(frame: OutgoingFrame, sequence: number): Uint8Array<ArrayBuffer> {
  const message = new Uint8Array(HEADER_BYTES + frame.payload.byteLength);
  const view = new DataView(message.buffer);
  view.setUint8(0, VERSION);
  view.setUint8(1, frame.key ? KEY : 0);
  view.setUint16(2, frame.width);
  view.setUint16(4, frame.height);
  view.setUint32(8, sequence);
  view.setBigUint64(16, BigInt(frame.timeUs));
  message.set(frame.payload, HEADER_BYTES);
  return message;
}

/** A packet of sound as one message. */
export function packSound(
  payload: Uint8Array,
  channels: number,
  timeUs: number,
  sequence: number,
): Uint8Array<ArrayBuffer> {
  const message = new Uint8Array(HEADER_BYTES + payload.byteLength);
  const view = new DataView(message.buffer);
  view.setUint8(0, VERSION);
  view.setUint8(1, SOUND);
  view.setUint16(2, channels);
  view.setUint32(8, sequence);
  view.setBigUint64(16, BigInt(timeUs));
  message.set(payload, HEADER_BYTES);
  return message;
}

/** Whether a message to a viewer is a packet of sound: its payload and time are read like a frame's. */
export const isSound = (buffer: ArrayBuffer): boolean => Boolean(new DataView(buffer).getUint8(1) & SOUND);

export function unpack(buffer: ArrayBuffer): IncomingFrame {
  const view = new DataView(buffer);
  return {
    key: Boolean(view.getUint8(1) & KEY),
    width: view.getUint16(2),
    height: view.getUint16(4),
    sequence: view.getUint32(8),
    serverMs: view.getUint32(12) / 1000,
    timeUs: Number(view.getBigUint64(16)),
    payload: new Uint8Array(buffer, HEADER_BYTES),
    bytes: buffer.byteLength,
  };
}

/** Open the socket of a session; `session` is one to resume, or empty. */
export const dial = (session: string): WebSocket => socketTo("/v1/live", session, storedKey());

/** Open the socket of a viewer; `session` is the one to watch, or empty for the newest. `sound`: whether it is wanted. */
export const dialView = (session: string, key: string, sound: boolean): WebSocket =>
  socketTo("/v1/live/view", session, key || storedKey(), sound);

const storedKey = (): string => authorisation().Authorization?.slice("Bearer ".length) ?? "";

function socketTo(path: string, session: string, key: string, sound = false): WebSocket {
  const address = new URL(under(path), location.href);
  if (session) address.searchParams.set("session", session);
  if (sound) address.searchParams.set("sound", "true");
  address.protocol = address.protocol.replace("http", "ws");
  const socket = new WebSocket(address, key ? [PROTOCOL, `impasto.key.${key}`] : [PROTOCOL]);
  socket.binaryType = "arraybuffer";
  return socket;
}

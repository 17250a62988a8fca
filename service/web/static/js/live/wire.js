/** The bytes and the address of docs/live.md: a header of 32 bytes before each frame, both ways. */

import { authorisation } from "../api.js";

const PROTOCOL = "impasto.live.1";
const VERSION = 1;
const HEADER_BYTES = 32;
const KEY = 1;

/**
 * A frame as one message.
 * @param {{key: boolean, width: number, height: number, sequence: number, timeUs: number}} header
 * @param {Uint8Array} payload
 */
export function pack({ key, width, height, sequence, timeUs }, payload) {
  const message = new Uint8Array(HEADER_BYTES + payload.byteLength);
  const view = new DataView(message.buffer);
  view.setUint8(0, VERSION);
  view.setUint8(1, key ? KEY : 0);
  view.setUint16(2, width);
  view.setUint16(4, height);
  view.setUint32(8, sequence);
  view.setBigUint64(16, BigInt(timeUs));
  message.set(payload, HEADER_BYTES);
  return message;
}

/** @param {ArrayBuffer} buffer @returns {{key, width, height, sequence, serverMs, timeUs, payload: Uint8Array}} */
export function unpack(buffer) {
  const view = new DataView(buffer);
  return {
    key: Boolean(view.getUint8(1) & KEY),
    width: view.getUint16(2),
    height: view.getUint16(4),
    sequence: view.getUint32(8),
    serverMs: view.getUint32(12) / 1000,
    timeUs: Number(view.getBigUint64(16)),
    payload: new Uint8Array(buffer, HEADER_BYTES),
  };
}

/** Open the socket; `session` is one to take up again, or empty. */
export function dial(session) {
  const address = new URL(session ? `/v1/live?session=${encodeURIComponent(session)}` : "/v1/live", location.href);
  address.protocol = address.protocol.replace("http", "ws");
  const key = authorisation().Authorization?.slice("Bearer ".length);
  const socket = new WebSocket(address, key ? [PROTOCOL, `impasto.key.${key}`] : [PROTOCOL]);
  socket.binaryType = "arraybuffer";
  return socket;
}

/** Label maps as PNG: one gray value a pixel, 8 or 16 bit. A canvas would keep only the upper 8 bits of 16. */

import { decode, encode } from "fast-png";

export interface LabelMap {
  width: number;
  height: number;
  /** Row by row: 0 = no cluster, 1 = background. */
  labels: Uint16Array;
}

/** Decode a gray PNG. Throws an Error for any other file. */
export function decodeLabels(bytes: Uint8Array): LabelMap {
  const { width, height, channels, palette, data } = decode(bytes);
  if (channels !== 1 || palette) throw new Error("This is not a label map.");
  return { width, height, labels: Uint16Array.from(data) };
}

/** Encode a label map as a gray PNG of 16 bit. */
export function encodeLabels({ width, height, labels }: LabelMap): Blob {
  const png = encode({ width, height, data: labels, depth: 16, channels: 1 });
  return new Blob([png as Uint8Array<ArrayBuffer>], { type: "image/png" });
}

/**
 * Label maps as PNG: one gray value a pixel, 8 or 16 bit. A canvas would keep only the upper 8 bits of 16.
 *
 * Source: PNG specification, third edition, sections 5 (chunks), 9 (filters). Only images without interlacing and
 * without a palette are read.
 */

export interface LabelMap {
  width: number;
  height: number;
  /** Row by row: 0 = no cluster, 1 = background. */
  labels: Uint16Array;
}

const SIGNATURE = [137, 80, 78, 71, 13, 10, 26, 10];
const GRAY = 0;

/** Decode a gray PNG. Throws an Error for any other file. */
export async function decodeLabels(bytes: Uint8Array): Promise<LabelMap> {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  if (SIGNATURE.some((value, i) => bytes[i] !== value)) throw new Error("This is not a PNG.");
  const [width, height, depth, kind, interlaced] = [16, 20, 24, 25, 28].map((at, i) =>
    i < 2 ? view.getUint32(at) : view.getUint8(at),
  ) as [number, number, number, number, number];
  if (kind !== GRAY || interlaced || (depth !== 8 && depth !== 16)) throw new Error("This is not a label map.");
  const packed: Uint8Array[] = [];
  for (let at = 8; at + 12 <= bytes.length; ) {
    const length = view.getUint32(at);
    if (typeAt(bytes, at + 4) === "IDAT") packed.push(bytes.subarray(at + 8, at + 8 + length));
    at += 12 + length;
  }
  const rows = unfiltered(await transformed(packed, new DecompressionStream("deflate")), height, depth / 8, width);
  const labels = new Uint16Array(width * height);
  for (let i = 0; i < labels.length; i++)
    labels[i] = depth === 8 ? (rows[i] ?? 0) : ((rows[2 * i] ?? 0) << 8) | (rows[2 * i + 1] ?? 0);
  return { width, height, labels };
}

/** Encode a label map as a gray PNG of 16 bit. */
export async function encodeLabels({ width, height, labels }: LabelMap): Promise<Blob> {
  const stride = 1 + 2 * width;
  const rows = new Uint8Array(stride * height);
  const view = new DataView(rows.buffer);
  for (let y = 0; y < height; y++)
    for (let x = 0; x < width; x++) view.setUint16(y * stride + 1 + 2 * x, labels[y * width + x] ?? 0);
  const head = new Uint8Array(13);
  const headView = new DataView(head.buffer);
  headView.setUint32(0, width);
  headView.setUint32(4, height);
  head.set([16, GRAY, 0, 0, 0], 8);
  const data = await transformed([rows], new CompressionStream("deflate"));
  const parts = [chunk("IHDR", head), chunk("IDAT", data), chunk("IEND", new Uint8Array(0))];
  return new Blob([new Uint8Array(SIGNATURE), ...parts], { type: "image/png" });
}

const typeAt = (bytes: Uint8Array, at: number): string => String.fromCharCode(...bytes.subarray(at, at + 4));

async function transformed(parts: Uint8Array[], by: CompressionStream | DecompressionStream): Promise<Uint8Array> {
  const stream = new Blob(parts as Uint8Array<ArrayBuffer>[]).stream().pipeThrough(by);
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Undo the filter of every row; `size`: bytes of a pixel. */
function unfiltered(data: Uint8Array, height: number, size: number, width: number): Uint8Array {
  const stride = width * size;
  const out = new Uint8Array(stride * height);
  for (let y = 0; y < height; y++) {
    const filter = data[y * (stride + 1)] ?? 0;
    for (let i = 0; i < stride; i++) {
      const raw = data[y * (stride + 1) + 1 + i] ?? 0;
      const left = i >= size ? (out[y * stride + i - size] ?? 0) : 0;
      const up = y ? (out[(y - 1) * stride + i] ?? 0) : 0;
      const corner = y && i >= size ? (out[(y - 1) * stride + i - size] ?? 0) : 0;
      out[y * stride + i] = raw + ([0, left, up, (left + up) >> 1, paeth(left, up, corner)][filter] ?? 0);
    }
  }
  return out;
}

function paeth(left: number, up: number, corner: number): number {
  const guess = left + up - corner;
  const [a, b, c] = [Math.abs(guess - left), Math.abs(guess - up), Math.abs(guess - corner)];
  if (a <= b && a <= c) return left;
  return b <= c ? up : corner;
}

function chunk(type: string, data: Uint8Array): Uint8Array<ArrayBuffer> {
  const out = new Uint8Array(12 + data.length);
  const view = new DataView(out.buffer);
  view.setUint32(0, data.length);
  for (let i = 0; i < 4; i++) out[4 + i] = type.charCodeAt(i);
  out.set(data, 8);
  view.setUint32(8 + data.length, crc(out.subarray(4, 8 + data.length)));
  return out;
}

const CRC_TABLE = Uint32Array.from({ length: 256 }, (_, n) => {
  let value = n;
  for (let bit = 0; bit < 8; bit++) value = value & 1 ? 0xedb88320 ^ (value >>> 1) : value >>> 1;
  return value;
});

function crc(bytes: Uint8Array): number {
  let value = 0xffffffff;
  for (const byte of bytes) value = (CRC_TABLE[(value ^ byte) & 0xff] ?? 0) ^ (value >>> 8);
  return (value ^ 0xffffffff) >>> 0;
}

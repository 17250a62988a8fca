/** Codecs that this browser can encode and decode, in the protocol's words, best first. */

import type { LiveInfo, Shape } from "./types";

/** H.264 levels times ten: macroblocks a frame and a second (ITU-T H.264, table A-1). */
const LEVELS: [level: number, frame: number, second: number][] = [
  [31, 3600, 108_000],
  [40, 8192, 245_760],
  [42, 8704, 522_240],
  [51, 36_864, 983_040],
];
/** Generous: compression artefacts come back as flicker of the regions. */
const BITS_PER_PIXEL = 0.22;

export const TITLES: Record<string, string> = { h264: "H.264", vp8: "VP8", jpeg: "JPEG", webp: "WebP" };

/** Configuration of a VideoEncoder for the codec. */
export function encoderConfig(codec: string, { width, height, fps }: Shape): VideoEncoderConfig {
  const bitrate = Math.round(width * height * fps * BITS_PER_PIXEL);
  const common = { width, height, framerate: fps, bitrate, latencyMode: "realtime" as const };
  if (codec === "vp8") return { ...common, codec: "vp8" };
  return { ...common, codec: avcName(width, height, fps), avc: { format: "annexb" } };
}

/** Constrained baseline, at the lowest level that fits. */
function avcName(width: number, height: number, fps: number): string {
  const blocks = Math.ceil(width / 16) * Math.ceil(height / 16);
  const level = LEVELS.find(([, most, rate]) => blocks <= most && blocks * fps <= rate)?.[0] ?? 52;
  return `avc1.42E0${level.toString(16).toUpperCase().padStart(2, "0")}`;
}

async function canEncode(codec: string, shape: Shape): Promise<boolean> {
  if (!("VideoEncoder" in globalThis)) return false;
  const answer = await VideoEncoder.isConfigSupported(encoderConfig(codec, shape)).catch(() => null);
  return answer?.supported ?? false;
}

async function canDecode(codec: string, { width, height, fps }: Shape): Promise<boolean> {
  if (!("VideoDecoder" in globalThis)) return false;
  const config = { codec: codec === "vp8" ? "vp8" : avcName(width, height, fps), optimizeForLatency: true };
  const answer = await VideoDecoder.isConfigSupported(config).catch(() => null);
  return answer?.supported ?? false;
}

export interface Offer {
  send: string[];
  receive: string[];
}

/** What to offer in `hello`: never empty, since JPEG always works. `wanted`: a codec to prefer both ways, or "auto". */
export async function offer(
  shape: Shape,
  service: Pick<LiveInfo, "receives" | "sends">,
  wanted: string,
): Promise<Offer> {
  const [encodes, decodes] = await Promise.all([supported(canEncode, shape), supported(canDecode, shape)]);
  return {
    send: chosen([...encodes, "jpeg"], service.receives, wanted),
    receive: chosen([...decodes, "jpeg"], service.sends, wanted),
  };
}

async function supported(can: (codec: string, shape: Shape) => Promise<boolean>, shape: Shape): Promise<string[]> {
  const codecs = ["h264", "vp8"];
  const able = await Promise.all(codecs.map((codec) => can(codec, shape)));
  return codecs.filter((_, i) => able[i]);
}

/** Codecs that both sides have, the wanted one first. */
function chosen(mine: string[], theirs: string[], wanted: string): string[] {
  const both = mine.filter((codec) => theirs.includes(codec));
  return both.includes(wanted) ? [wanted, ...both.filter((codec) => codec !== wanted)] : both;
}

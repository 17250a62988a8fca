/** What this browser can encode and decode, in the protocol's words, best first. */

/** H.264 levels times ten: macroblocks a frame and a second (ITU-T H.264, table A-1). */
const LEVELS = [[31, 3600, 108_000], [40, 8192, 245_760], [42, 8704, 522_240], [51, 36_864, 983_040]];
/** Generous: what compression loses comes back as flicker of the regions. */
const BITS_PER_PIXEL = 0.22;

export const TITLES = { h264: "H.264", vp8: "VP8", jpeg: "JPEG", webp: "WebP" };

/** Configuration of a VideoEncoder for the codec. */
export function encoderConfig(codec, { width, height, fps }) {
  const common = { width, height, framerate: fps, bitrate: Math.round(width * height * fps * BITS_PER_PIXEL), latencyMode: "realtime" };
  return codec === "vp8" ? { ...common, codec: "vp8" } : { ...common, codec: avcName(width, height, fps), avc: { format: "annexb" } };
}

/** Constrained baseline, at the lowest level that fits. */
function avcName(width, height, fps) {
  const blocks = Math.ceil(width / 16) * Math.ceil(height / 16);
  const level = LEVELS.find(([, most, rate]) => blocks <= most && blocks * fps <= rate)?.[0] ?? 52;
  return `avc1.42E0${level.toString(16).toUpperCase().padStart(2, "0")}`;
}

const supported = (kind, config) =>
  typeof kind === "undefined" ? false : kind.isConfigSupported(config).then((answer) => answer.supported, () => false);

const canEncode = (codec, shape) => supported(globalThis.VideoEncoder, encoderConfig(codec, shape));
const canDecode = (codec, { width, height, fps }) =>
  supported(globalThis.VideoDecoder, { codec: codec === "vp8" ? "vp8" : avcName(width, height, fps), optimizeForLatency: true });

/**
 * What to offer in `hello`.
 * @param {{width, height, fps}} shape of the frames
 * @param {{receives: string[], sends: string[]}} service what it has
 * @param {string} wanted a codec to prefer both ways, or "auto"
 * @returns {Promise<{send: string[], receive: string[]}>} never empty: JPEG always works
 */
export async function offer(shape, service, wanted) {
  const [encodes, decodes] = await Promise.all([canEncode, canDecode].map((can) => those(["h264", "vp8"], (codec) => can(codec, shape))));
  return {
    send: chosen([...encodes, "jpeg"], service.receives, wanted),
    receive: chosen([...decodes, "jpeg"], service.sends, wanted),
  };
}

async function those(codecs, can) {
  const able = await Promise.all(codecs.map(can));
  return codecs.filter((_, i) => able[i]);
}

/** What both have, the wanted one first. */
function chosen(mine, theirs, wanted) {
  const both = mine.filter((codec) => theirs.includes(codec));
  return both.includes(wanted) ? [wanted, ...both.filter((codec) => codec !== wanted)] : both;
}

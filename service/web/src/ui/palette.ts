/** Colours: their forms, and the main ones of a picture. */

export type Rgb = readonly [red: number, green: number, blue: number];

export const hexOf = (rgb: Iterable<number>): string =>
  `#${[...rgb].map((value) => Math.round(value).toString(16).padStart(2, "0")).join("")}`;

/** Hue in degrees, saturation and value 0..1. */
export interface Hsv {
  hue: number;
  saturation: number;
  value: number;
}

export function hsvOf([red, green, blue]: Rgb): Hsv {
  const most = Math.max(red, green, blue);
  const range = most - Math.min(red, green, blue);
  const turn =
    range === 0
      ? 0
      : most === red
        ? (green - blue) / range
        : most === green
          ? 2 + (blue - red) / range
          : 4 + (red - green) / range;
  return { hue: (60 * turn + 360) % 360, saturation: most ? range / most : 0, value: most / 255 };
}

export function rgbOfHsv({ hue, saturation, value }: Hsv): [number, number, number] {
  const channel = (n: number) => {
    const k = (n + hue / 60) % 6;
    return Math.round(255 * value * (1 - saturation * Math.max(0, Math.min(k, 4 - k, 1))));
  };
  return [channel(5), channel(3), channel(1)];
}

/**
 * The main colours of a picture, dark ones first: median cut (Heckbert 1982), in which the box with the largest spread, by
 * pixels, is cut at the mean of its widest channel, not at the median: an area of one colour stays whole.
 *
 * @param pixels RGBA, 8 bit; transparent pixels are left out
 */
export function mainColours(pixels: Uint8ClampedArray, most: number): string[] {
  const colours: Rgb[] = [];
  const step = Math.max(1, Math.floor(pixels.length / 4 / 20_000));
  for (let i = 0; i < pixels.length; i += 4 * step)
    if ((pixels[i + 3] ?? 0) > 127) colours.push([pixels[i] ?? 0, pixels[i + 1] ?? 0, pixels[i + 2] ?? 0]);
  let boxes = colours.length ? [boxOf(colours)] : [];
  while (boxes.length < most) {
    const widest = boxes.reduce(
      (a, b) => (b.spread * b.colours.length > a.spread * a.colours.length ? b : a),
      boxes[0] as Box,
    );
    if (!widest?.spread) break;
    const middle = mean(widest.colours, widest.channel);
    const [below, above] = [true, false].map((low) =>
      widest.colours.filter((colour) => (colour[widest.channel] ?? 0) <= middle === low),
    ) as [Rgb[], Rgb[]];
    boxes = [...boxes.filter((box) => box !== widest), boxOf(below), boxOf(above)];
  }
  const means = boxes.map(({ colours }) => [0, 1, 2].map((i) => mean(colours, i)));
  const light = ([red = 0, green = 0, blue = 0]: number[]) => 0.3 * red + 0.59 * green + 0.11 * blue;
  return [...new Set(means.sort((a, b) => light(a) - light(b)).map(hexOf))];
}

interface Box {
  colours: readonly Rgb[];
  /** With the largest range, and this range. */
  channel: number;
  spread: number;
}

function boxOf(colours: readonly Rgb[]): Box {
  let [channel, spread] = [0, 0];
  for (let i = 0; i < 3; i++) {
    let [least, most] = [255, 0];
    for (const colour of colours) {
      const value = colour[i] ?? 0;
      if (value < least) least = value;
      if (value > most) most = value;
    }
    if (most - least > spread) [channel, spread] = [i, most - least];
  }
  return { colours, channel, spread };
}

const mean = (colours: readonly Rgb[], channel: number): number =>
  colours.reduce((sum, colour) => sum + (colour[channel] ?? 0), 0) / Math.max(1, colours.length);

/** Longest side of a picture from which colours are taken, px. */
const SIDE_PX = 320;

/** RGBA of a picture or a playing video, reduced: 8 bit. Rejects if a file is no picture. */
export async function pixelsOf(source: ImageBitmapSource, sidePx = SIDE_PX): Promise<Uint8ClampedArray> {
  const picture = await createImageBitmap(source);
  const scale = Math.min(1, sidePx / Math.max(picture.width, picture.height));
  const width = Math.max(1, Math.round(picture.width * scale));
  const height = Math.max(1, Math.round(picture.height * scale));
  const context = new OffscreenCanvas(width, height).getContext("2d");
  if (!context) throw new Error("The browser has no canvas.");
  context.drawImage(picture, 0, 0, width, height);
  picture.close();
  return context.getImageData(0, 0, width, height).data;
}

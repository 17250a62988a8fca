/** Brushes from files: a picture, whose paint becomes the stamp, and brush sets of Photoshop (.abr), read by ag-psd. */

import type { Abr } from "ag-psd/dist/abr";
import { Problem } from "../../api/http";
import { ROUND, STEADY, type Tip } from "../document/tip";
import type { BrushPreset } from "./brushes";
import { createCanvas } from "./canvas";
import { clamp } from "./geometry";
import { tipPicture } from "./tip-picture";

/** Largest picture, px: its pixels are read at once. */
const MOST_PX = 4096 * 4096;

/** The brushes of a file. Throws a Problem if it has none. */
export async function brushesOf(file: File): Promise<BrushPreset[]> {
  return /\.abr$/i.test(file.name) ? photoshopBrushes(file) : [await pictureBrush(file)];
}

const stem = (file: File): string => file.name.replace(/\.[^.]*$/, "");

/** Where a picture is transparent somewhere, its alpha is the paint; else its darkness. */
async function pictureBrush(file: File): Promise<BrushPreset> {
  const picture = await createImageBitmap(file).catch(() => {
    throw new Problem({
      title: "No brush",
      detail: `“${file.name}” is neither a picture nor a brush set.`,
      remedy: "Use a PNG, or a brush set of Photoshop (.abr).",
    });
  });
  const { width, height } = picture;
  if (width * height > MOST_PX)
    throw new Problem({
      detail: `“${file.name}” has ${width} × ${height} pixels.`,
      remedy: "Use at most 4096 × 4096.",
    });
  const [, context] = createCanvas(picture);
  context.drawImage(picture, 0, 0);
  const { data } = context.getImageData(0, 0, width, height);
  const tip = {
    ...ROUND,
    shape: "picture" as const,
    spacing: 0.15,
    picture: stampOf(file, width, height, paintOf(data)),
  };
  return { name: stem(file), size: clamp(Math.max(width, height), 8, 120), opacity: 1, tip };
}

/** Paint 0..255 of RGBA pixels. */
export function paintOf(data: Uint8ClampedArray): Uint8Array {
  const paint = new Uint8Array(data.length / 4);
  const clear = data.some((value, i) => i % 4 === 3 && value < 255);
  for (let i = 0, at = 0; i < paint.length; i++, at += 4) {
    const light = 0.299 * (data[at] ?? 0) + 0.587 * (data[at + 1] ?? 0) + 0.114 * (data[at + 2] ?? 0);
    paint[i] = clear ? (data[at + 3] ?? 0) : 255 - light;
  }
  return paint;
}

function stampOf(file: File, width: number, height: number, paint: Uint8Array): string {
  try {
    return tipPicture(width, height, paint);
  } catch (error) {
    throw new Problem({ detail: `“${file.name}”: ${(error as Error).message}`, remedy: "Use a dark or opaque shape." });
  }
}

async function photoshopBrushes(file: File): Promise<BrushPreset[]> {
  const { readAbr } = await import("ag-psd");
  const bytes = new Uint8Array(await file.arrayBuffer());
  let set: ReturnType<typeof readAbr>;
  try {
    set = readAbr(bytes);
  } catch (error) {
    throw new Problem({
      detail: `“${file.name}” cannot be read: ${(error as Error).message}`,
      remedy: "Export the brush set from a recent version of Photoshop (version 6 or later of the format).",
    });
  }
  const found = presetsOf(set);
  if (!found.length)
    throw new Problem({
      detail: `“${file.name}” has no brush with a round or a sampled tip.`,
      remedy: "Export one of its stamps as PNG, and open that.",
    });
  return found;
}

/** The round and the sampled brushes of a set; others have tips that are computed from settings unknown here. */
export function presetsOf({ brushes, samples }: Pick<Abr, "brushes" | "samples">): BrushPreset[] {
  return brushes.flatMap((brush): BrushPreset[] => {
    const { shape, name } = brush;
    if (shape.type !== "computed" && shape.type !== "sampled") return [];
    const preset = { name, size: clamp(Math.round(shape.size), 1, 400), opacity: 1 };
    const tip = photoshopTip(brush, shape);
    if (shape.type === "computed") return [{ ...preset, tip }];
    const sample = samples.find(({ id }) => id === shape.sampledData);
    if (!sample?.alpha.some((value) => value > 0)) return [];
    const picture = tipPicture(sample.bounds.w, sample.bounds.h, sample.alpha);
    return [{ ...preset, tip: { ...tip, shape: "picture", picture } }];
  });
}

type Shape = Extract<Abr["brushes"][number]["shape"], { type: "computed" | "sampled" }>;

function photoshopTip({ scatter, shapeDynamics }: Abr["brushes"][number], shape: Shape): Tip {
  const { sizeDynamics, angleDynamics, minimumDiameter } = shapeDynamics ?? {};
  const smallest = minimumDiameter ?? 0;
  return {
    ...ROUND,
    spacing: clamp(shape.spacingOn ? shape.spacing : 0.1, 0.02, 2),
    angle: shape.angle,
    roundness: clamp(shape.roundness, 0.05, 1),
    hardness: shape.type === "computed" ? clamp(shape.hardness, 0, 1) : ROUND.hardness,
    scatter: clamp(scatter?.scatterDynamics.jitter ?? 0, 0, 2),
    sizeJitter: clamp(sizeDynamics?.jitter ?? 0, 0, 1),
    angleJitter: clamp(angleDynamics?.jitter ?? 0, 0, 1),
    size:
      sizeDynamics?.control === "pen pressure"
        ? { pressure: [smallest, (1 + smallest) / 2, 1], tilt: STEADY.tilt }
        : STEADY,
  };
}

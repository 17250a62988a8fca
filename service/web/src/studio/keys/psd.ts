/** Photoshop documents (PSD) with layers, as other painting programs read and write them. ag-psd is loaded on demand. */

import type { BlendMode, Psd, Layer as PsdLayer } from "ag-psd";
import { Problem } from "../../api/api";
import type { PaintBlend } from "../drawing/blend";
import { createCanvas } from "../drawing/canvas";
import type { Size } from "../drawing/geometry";

/** A layer of the document's size, from back to front; a group follows its layers. */
export interface RasterLayer {
  id: string;
  name: string;
  /** null: a group. */
  canvas: HTMLCanvasElement | null;
  /** Its opacity says where the layer is visible; null: everywhere. */
  mask: HTMLCanvasElement | null;
  opacity: number;
  visible: boolean;
  blend: PaintBlend;
  clip: boolean;
  locked: boolean;
  parent: string | null;
}

export const isPsd = (file: File): boolean => /\.psd$/i.test(file.name);

const NAMES: Partial<Record<PaintBlend, BlendMode>> = {
  over: "normal",
  add: "linear dodge",
  "pass-through": "pass through",
};
const nameOf = (blend: PaintBlend): BlendMode => NAMES[blend] ?? (blend.replace("-", " ") as BlendMode);
const KNOWN: readonly PaintBlend[] = [
  ...["over", "multiply", "screen", "overlay", "darken", "lighten", "color-dodge", "color-burn", "hard-light"],
  ...["soft-light", "difference", "exclusion", "hue", "saturation", "color", "luminosity", "add", "pass-through"],
] as PaintBlend[];
const BLENDS = new Map(KNOWN.map((blend) => [nameOf(blend), blend]));

/** A PSD of layers; `whole` is the picture that all visible ones make. */
export async function makePsd(
  { width, height }: Size,
  layers: readonly RasterLayer[],
  whole: HTMLCanvasElement,
): Promise<Blob> {
  const { writePsd } = await import("ag-psd");
  const children = childrenOf(layers, null);
  const bytes = writePsd({ width, height, children, canvas: whole });
  return new Blob([bytes], { type: "image/vnd.adobe.photoshop" });
}

function childrenOf(layers: readonly RasterLayer[], parent: string | null): PsdLayer[] {
  return layers
    .filter((layer) => layer.parent === parent)
    .map(({ id, name, canvas, mask, opacity, visible, blend, clip, locked }): PsdLayer => {
      const layer: PsdLayer = { name, opacity, hidden: !visible, blendMode: nameOf(blend), clipping: clip };
      if (locked) layer.transparencyProtected = true;
      if (mask) {
        const { width: right, height: bottom } = mask;
        layer.mask = { left: 0, top: 0, right, bottom, defaultColor: 255, canvas: grayOfOpacity(mask) };
      }
      if (canvas) Object.assign(layer, { canvas, left: 0, top: 0 });
      else Object.assign(layer, { children: childrenOf(layers, id), opened: true });
      return layer;
    });
}

/** White where a canvas is opaque, on black. */
function grayOfOpacity(mask: HTMLCanvasElement): HTMLCanvasElement {
  const [canvas, context] = createCanvas(mask);
  context.drawImage(mask, 0, 0);
  for (const [how, color] of [
    ["source-in", "#fff"],
    ["destination-over", "#000"],
  ] as const) {
    Object.assign(context, { globalCompositeOperation: how, fillStyle: color });
    context.fillRect(0, 0, mask.width, mask.height);
  }
  return canvas;
}

export interface ReadPsd {
  size: Size;
  layers: RasterLayer[];
  /** Names of layers that look otherwise in the program that made them. */
  simplified: string[];
}

/** The layers of a PSD, at its own size. Throws a Problem if it cannot be read. */
export async function readLayers(file: File): Promise<ReadPsd> {
  const { readPsd } = await import("ag-psd");
  const bytes = await file.arrayBuffer();
  const psd = ((): Psd => {
    try {
      return readPsd(bytes, { skipThumbnail: true, skipLinkedFilesData: true });
    } catch (error) {
      const reason = error instanceof Error ? error.message : String(error);
      const remedy = "Save it as PSD with 8 bits a channel in RGB, or as PNG.";
      throw new Problem({ detail: `“${file.name}” cannot be read: ${reason}.`, remedy });
    }
  })();
  const { width, height } = psd;
  const found = { size: { width, height }, layers: [], simplified: [], count: 0 } as Collected;
  if (psd.children?.length) collect(psd.children, null, found);
  else if (psd.canvas) found.layers.push({ ...rasterLayer({ name: file.name }, "import-1"), canvas: psd.canvas });
  if (!found.layers.some(({ canvas }) => canvas))
    throw new Problem({ detail: `“${file.name}” has no pixels.`, remedy: "Save it with raster layers." });
  return found;
}

type Collected = ReadPsd & { count: number };

function collect(children: readonly PsdLayer[], parent: string | null, found: Collected): void {
  for (const layer of children) {
    const id = `import-${++found.count}`;
    const made = { ...rasterLayer(layer, id), parent };
    if (isSimplified(layer)) found.simplified.push(made.name);
    if (layer.mask && !layer.mask.disabled) made.mask = maskOf(layer.mask, found.size);
    if (layer.children) {
      collect(layer.children, id, found);
      found.layers.push(made);
    } else if (layer.canvas) {
      const [canvas, context] = createCanvas(found.size);
      context.drawImage(layer.canvas as HTMLCanvasElement, layer.left ?? 0, layer.top ?? 0);
      found.layers.push({ ...made, canvas });
    }
  }
}

const rasterLayer = (layer: PsdLayer, id: string): RasterLayer => ({
  id,
  name: layer.name || "Layer",
  canvas: null,
  mask: null,
  opacity: (layer.opacity ?? 1) * (layer.fillOpacity ?? 1),
  visible: !layer.hidden,
  blend: BLENDS.get(layer.blendMode ?? "normal") ?? "over",
  clip: Boolean(layer.clipping),
  locked: Boolean(layer.transparencyProtected),
  parent: null,
});

/** The brightness of a mask as opacity, at the document's size. */
function maskOf(mask: NonNullable<PsdLayer["mask"]>, size: Size): HTMLCanvasElement {
  const [canvas, context] = createCanvas(size);
  const gray = mask.defaultColor ?? 0;
  context.fillStyle = `rgb(${gray} ${gray} ${gray})`;
  context.fillRect(0, 0, size.width, size.height);
  if (mask.canvas) context.drawImage(mask.canvas as HTMLCanvasElement, mask.left ?? 0, mask.top ?? 0);
  const image = context.getImageData(0, 0, size.width, size.height);
  const { data } = image;
  for (let i = 0; i < data.length; i += 4) data.set([255, 255, 255, data[i] ?? 0], i);
  context.putImageData(image, 0, 0);
  return canvas;
}

/** Whether the layer looks otherwise in the program that made it. */
const isSimplified = ({ blendMode, mask, effects, adjustment, vectorMask }: PsdLayer): boolean =>
  Boolean(
    (blendMode && !BLENDS.has(blendMode)) ||
      adjustment ||
      (vectorMask && !vectorMask.disable) ||
      mask?.userMaskFeather ||
      (effects && !effects.disabled),
  );

/** Photoshop documents (PSD) with layers, as other painting programs read and write them. ag-psd is loaded on demand. */

import type { Layer as PsdLayer } from "ag-psd";
import { Problem } from "../../api/api";
import type { Size } from "../drawing/geometry";
import { createCanvas } from "../drawing/raster";

/** A raster layer of the document's size, from back to front. */
export interface RasterLayer {
  name: string;
  canvas: HTMLCanvasElement;
  opacity: number;
  visible: boolean;
}

export const isPsd = (file: File): boolean => /\.psd$/i.test(file.name);

/** A PSD of layers; `whole` is the picture that all visible ones make. */
export async function makePsd({ width, height }: Size, layers: RasterLayer[], whole: HTMLCanvasElement): Promise<Blob> {
  const { writePsd } = await import("ag-psd");
  const children = layers.map(({ name, canvas, opacity, visible }) => ({
    name,
    canvas,
    opacity,
    hidden: !visible,
    left: 0,
    top: 0,
  }));
  const bytes = writePsd({ width, height, children, canvas: whole });
  return new Blob([bytes], { type: "image/vnd.adobe.photoshop" });
}

export interface ReadPsd {
  layers: RasterLayer[];
  /** Names of layers whose blend mode, mask or effects are not kept. */
  simplified: string[];
}

/** The raster layers of a PSD of exactly this size. Throws a Problem if it has another size, or cannot be read. */
export async function readLayers(file: File, size: Size): Promise<ReadPsd> {
  const { readPsd } = await import("ag-psd");
  const bytes = await file.arrayBuffer();
  const psd = (() => {
    try {
      return readPsd(bytes, { skipThumbnail: true, skipLinkedFilesData: true });
    } catch (error) {
      const reason = error instanceof Error ? error.message : String(error);
      const remedy = "Save it as PSD with 8 bits a channel in RGB, or as PNG.";
      throw new Problem({ detail: `“${file.name}” cannot be read: ${reason}.`, remedy });
    }
  })();
  checkSize(file.name, psd, size);
  const found: ReadPsd = { layers: [], simplified: [] };
  if (psd.children?.length) collect(psd.children, { opacity: 1, visible: true }, size, found);
  else if (psd.canvas) found.layers.push({ name: file.name, canvas: psd.canvas, opacity: 1, visible: true });
  if (!found.layers.length)
    throw new Problem({ detail: `“${file.name}” has no pixels.`, remedy: "Save it with raster layers." });
  return found;
}

function checkSize(name: string, psd: Size, { width, height }: Size): void {
  if (psd.width === width && psd.height === height) return;
  throw new Problem({
    title: "The picture has another size",
    detail: `“${name}” has ${psd.width} × ${psd.height} pixels, the video has ${width} × ${height}.`,
    remedy: "Export the frame here, paint on it, and keep its size.",
  });
}

/** Layers of a group have its opacity and visibility, too. */
function collect(children: PsdLayer[], group: { opacity: number; visible: boolean }, size: Size, found: ReadPsd): void {
  for (const layer of children) {
    const opacity = group.opacity * (layer.opacity ?? 1);
    const visible = group.visible && !layer.hidden;
    if (layer.children) {
      collect(layer.children, { opacity, visible }, size, found);
      continue;
    }
    if (!layer.canvas) continue;
    const name = layer.name || `Layer ${found.layers.length + 1}`;
    if (isSimplified(layer)) found.simplified.push(name);
    const [canvas, context] = createCanvas(size);
    context.drawImage(layer.canvas as HTMLCanvasElement, layer.left ?? 0, layer.top ?? 0);
    found.layers.push({ name, canvas, opacity, visible });
  }
}

/** Whether the layer looks otherwise in the program that made it. */
const isSimplified = ({ blendMode, mask, effects, clipping }: PsdLayer): boolean =>
  Boolean((blendMode && blendMode !== "normal") || mask || effects || clipping);

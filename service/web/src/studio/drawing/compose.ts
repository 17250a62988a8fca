/**
 * Composites the layers of a key as Photoshop does: groups, masks, clipping, blend modes.
 *
 * A layer that is clipped is visible only where the layer below it is: it is blended with that one's colours alone, as if
 * these were opaque, so that soft edges have no fringe of its own colour; both are then laid on what is below with the lower
 * one's opacity and mode. A group is composited by itself, unless it passes through.
 */

import { operationOf } from "./blend";
import { type Context, createCanvas } from "./canvas";
import type { Size } from "./geometry";
import type { Rect } from "./rect";
import type { PictureLayer } from "./strokes";

export interface Content {
  /** Pixels of a layer that is no group, with the stroke under the pen. */
  canvas(layer: PictureLayer): CanvasImageSource;
  /** The picture of a mask, whose opacity counts; undefined while it is not loaded. */
  mask(layer: PictureLayer): CanvasImageSource | undefined;
}

/** A layer, and those that are clipped to it, from back to front. */
interface Clipped {
  base: PictureLayer;
  above: readonly PictureLayer[];
}

/** Layers of a group (null: those in none) with their clipped ones. The lowest layer cannot be clipped. */
export function clippedLayers(layers: readonly PictureLayer[], parent: string | null): Clipped[] {
  const found: { base: PictureLayer; above: PictureLayer[] }[] = [];
  for (const layer of layers) {
    if ((layer.parent ?? null) !== parent) continue;
    const last = found.at(-1);
    if (layer.clip && last) last.above.push(layer);
    else found.push({ base: layer, above: [] });
  }
  return found;
}

/** Whether a layer hides everything below it. */
export const isPlain = (layer: PictureLayer): boolean =>
  layer.visible &&
  layer.opacity === 1 &&
  (layer.blend ?? "over") === "over" &&
  !(layer.mask || layer.group || layer.parent || layer.clip);

export class Compositor {
  private readonly scratches: [HTMLCanvasElement, Context][] = [];
  private used = 0;

  constructor(private readonly size: Size) {}

  /** Draw the visible layers on a context of the picture's size. */
  draw(context: Context, layers: readonly PictureLayer[], content: Content): void {
    this.used = 0;
    this.siblings(context, layers, null, content);
  }

  private siblings(context: Context, layers: readonly PictureLayer[], parent: string | null, content: Content): void {
    for (const { base, above } of clippedLayers(layers, parent)) {
      if (!base.visible) continue;
      const before = this.used;
      const shown = above.filter(({ visible }) => visible);
      if (base.group && base.blend === "pass-through" && !shown.length) this.through(context, layers, base, content);
      else {
        const own = this.pixels(layers, base, content);
        lay(context, shown.length ? this.clipped(layers, own, shown, content) : own, base);
      }
      this.used = before;
    }
  }

  /** The pixels of a layer or of a group, with its mask. */
  private pixels(layers: readonly PictureLayer[], layer: PictureLayer, content: Content): CanvasImageSource {
    const mask = content.mask(layer);
    if (!layer.group && !mask) return content.canvas(layer);
    const [canvas, context] = this.scratch();
    if (layer.group) this.siblings(context, layers, layer.id, content);
    else context.drawImage(content.canvas(layer), 0, 0);
    if (mask) put(context, "destination-in", mask, this.size);
    return canvas;
  }

  /** A layer with those that are clipped to it: these are blended with its colours, its opacity stays. */
  private clipped(
    layers: readonly PictureLayer[],
    own: CanvasImageSource,
    above: readonly PictureLayer[],
    content: Content,
  ): CanvasImageSource {
    const [canvas, context] = this.scratch();
    context.drawImage(own, 0, 0);
    makeOpaque(context);
    for (const layer of above) {
      const before = this.used;
      lay(context, this.pixels(layers, layer, content), layer);
      this.used = before;
    }
    put(context, "destination-in", own, this.size);
    return canvas;
  }

  /** The layers of a group, each blended with all that is below; mixed with that by the group's opacity and mask. */
  private through(context: Context, layers: readonly PictureLayer[], group: PictureLayer, content: Content): void {
    const mask = content.mask(group);
    if (group.opacity === 1 && !mask) {
      this.siblings(context, layers, group.id, content);
      return;
    }
    const [canvas, inside] = this.scratch();
    inside.drawImage(context.canvas, 0, 0);
    this.siblings(inside, layers, group.id, content);
    const [share, of] = this.scratch();
    of.globalAlpha = group.opacity;
    if (mask) of.drawImage(mask, 0, 0, this.size.width, this.size.height);
    else of.fillRect(0, 0, this.size.width, this.size.height);
    of.globalAlpha = 1;
    put(inside, "destination-in", share, this.size);
    put(context, "destination-out", share, this.size);
    put(context, "lighter", canvas, this.size);
  }

  private scratch(): [HTMLCanvasElement, Context] {
    const known = this.scratches[this.used] ?? createCanvas(this.size);
    this.scratches[this.used++] = known;
    const [canvas, context] = known;
    context.clearRect(0, 0, canvas.width, canvas.height);
    return known;
  }
}

function lay(context: Context, pixels: CanvasImageSource, { opacity, blend }: PictureLayer): void {
  context.globalAlpha = opacity;
  context.globalCompositeOperation = operationOf(blend);
  context.drawImage(pixels, 0, 0);
  context.globalAlpha = 1;
  context.globalCompositeOperation = "source-over";
}

function put(context: Context, how: GlobalCompositeOperation, pixels: CanvasImageSource, size: Size): void {
  context.globalCompositeOperation = how;
  context.drawImage(pixels, 0, 0, size.width, size.height);
  context.globalCompositeOperation = "source-over";
}

/** Make every pixel that has a colour opaque. */
export function makeOpaque(context: Context): void {
  const { width, height } = context.canvas;
  const image = context.getImageData(0, 0, width, height);
  const { data } = image;
  for (let i = 3; i < data.length; i += 4) if (data[i]) data[i] = 255;
  context.putImageData(image, 0, 0);
}

/** Draw on a layer whose opacity stays as it is, within a rectangle. */
export function drawLocked(context: Context, rect: Rect, draw: (own: Context) => void): void {
  const [before] = copyOf(context);
  const [opaque, own] = copyOf(context);
  makeOpaque(own);
  draw(own);
  replaceColours(context, rect, opaque, before);
}

function copyOf({ canvas }: Context): [HTMLCanvasElement, Context] {
  const [copy, own] = createCanvas(canvas);
  own.drawImage(canvas, 0, 0);
  return [copy, own];
}

/** Give a rectangle the colours of one canvas where another one is opaque. */
export function replaceColours(
  context: Context,
  { x, y, width, height }: Rect,
  colours: HTMLCanvasElement,
  opacity: HTMLCanvasElement,
): void {
  context.save();
  context.beginPath();
  context.rect(x, y, width, height);
  context.clip();
  context.clearRect(x, y, width, height);
  context.globalCompositeOperation = "source-over";
  context.drawImage(colours, 0, 0);
  context.globalCompositeOperation = "destination-in";
  context.drawImage(opacity, 0, 0);
  context.restore();
}

/** Of the colour that shows where a key does not count. */
const VEIL = "rgb(24 18 40 / 60%)";

/** Darken a key where its mask has no paint. */
export function drawVeil(context: Context, mask: HTMLCanvasElement): void {
  const [veil, own] = createCanvas(mask);
  own.fillStyle = VEIL;
  own.fillRect(0, 0, mask.width, mask.height);
  put(own, "destination-out", mask, mask);
  context.drawImage(veil, 0, 0);
}

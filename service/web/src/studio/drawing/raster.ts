/** Drawing painted layers on canvases of the video's size. */

import type { Size } from "./geometry";
import { pngOf } from "./png";
import { Smudger } from "./smudge";
import {
  type BrushStroke,
  type DrawnStroke,
  type FillStroke,
  type KeyPicture,
  type PictureLayer,
  rowsOf,
  type Sample,
  type SmudgeStroke,
  type Stroke,
  widthAt,
} from "./strokes";

type Context = CanvasRenderingContext2D;

export function createCanvas({ width, height }: Size): [HTMLCanvasElement, Context] {
  const canvas = document.createElement("canvas");
  Object.assign(canvas, { width, height });
  const context = canvas.getContext("2d", { willReadFrequently: true });
  if (!context) throw new Error("The browser gave no canvas.");
  return [canvas, context];
}

/** Draw the part of a brush stroke between samples `from` and `until`. */
function drawSegments(context: Context, stroke: BrushStroke, from: number, until: number): void {
  context.lineCap = "round";
  context.lineJoin = "round";
  context.strokeStyle = stroke.kind === "eraser" ? "#000" : stroke.color;
  for (let i = Math.max(1, from); i < until; i++) {
    const [a, b] = [stroke.samples[i - 1], stroke.samples[i]];
    if (a && b) drawSegment(context, stroke.size, a, b);
  }
  const only = stroke.samples[0];
  if (from === 0 && only) drawSegment(context, stroke.size, only, [only[0] + 0.01, only[1], only[2]]);
}

function drawSegment(context: Context, size: number, a: Sample, b: Sample): void {
  context.lineWidth = (widthAt(size, a[2]) + widthAt(size, b[2])) / 2;
  context.beginPath();
  context.moveTo(a[0], a[1]);
  context.lineTo(b[0], b[1]);
  context.stroke();
}

/** Draw one whole stroke; overlapping parts of a translucent stroke do not add up. */
function drawStroke(context: Context, stroke: Stroke, size: Size): void {
  context.save();
  if (stroke.kind === "fill") drawFill(context, stroke, size);
  else if (stroke.kind === "smudge") {
    const smudger = new Smudger(context, stroke);
    for (const sample of stroke.samples) smudger.to(sample);
  } else if (stroke.opacity >= 1) {
    context.globalCompositeOperation = stroke.kind === "eraser" ? "destination-out" : "source-over";
    drawSegments(context, stroke, 0, stroke.samples.length);
  } else {
    const [scratch, own] = createCanvas(size);
    drawSegments(own, stroke, 0, stroke.samples.length);
    context.globalAlpha = stroke.opacity;
    context.globalCompositeOperation = stroke.kind === "eraser" ? "destination-out" : "source-over";
    context.drawImage(scratch, 0, 0);
  }
  context.restore();
}

function drawFill(context: Context, { color, opacity, runs }: FillStroke, { width }: Size): void {
  context.fillStyle = color;
  context.globalAlpha = opacity;
  for (const [x, y, length] of rowsOf(runs, width)) context.fillRect(x, y, length, 1);
}

interface Drawn {
  canvas: HTMLCanvasElement;
  context: Context;
  base: string | null;
  strokes: readonly Stroke[];
}

/** The stroke under the pen; its samples grow in place. */
export interface LiveStroke {
  layer: string;
  stroke: DrawnStroke;
}

interface Composed {
  canvas: HTMLCanvasElement;
  context: Context;
  /** null: with a stroke under the pen. */
  picture: KeyPicture | null;
  layers: readonly HTMLCanvasElement[];
}

interface LiveDrawing {
  stroke: DrawnStroke;
  /** The strokes of the layer below it. */
  on: readonly Stroke[];
  /** The layer with the stroke, up to its newest sample. */
  whole(layer: HTMLCanvasElement): HTMLCanvasElement;
}

/** A growing brush stroke: on a canvas of its own, which is laid over the layer. */
function liveBrush(stroke: BrushStroke, size: Size): LiveDrawing["whole"] {
  const [scratch, own] = createCanvas(size);
  const [whole, context] = createCanvas(size);
  let drawn = 0;
  return (layer) => {
    drawSegments(own, stroke, drawn, stroke.samples.length);
    drawn = stroke.samples.length;
    context.globalCompositeOperation = "copy";
    context.drawImage(layer, 0, 0);
    context.globalCompositeOperation = stroke.kind === "eraser" ? "destination-out" : "source-over";
    context.globalAlpha = stroke.opacity;
    context.drawImage(scratch, 0, 0);
    context.globalAlpha = 1;
    return whole;
  };
}

/** A growing smudge, on a copy of the layer. */
function liveSmudge(stroke: SmudgeStroke, size: Size): LiveDrawing["whole"] {
  const [whole, context] = createCanvas(size);
  const smudger = new Smudger(context, stroke);
  let drawn = 0;
  return (layer) => {
    if (!drawn) context.drawImage(layer, 0, 0);
    for (const sample of stroke.samples.slice(drawn)) smudger.to(sample);
    drawn = stroke.samples.length;
    return whole;
  };
}

/**
 * Bytes of canvases and pictures that are kept, beside those of the picture that is drawn: four of each at 1080p. The
 * browser's decoder of a long 1080p video alone takes several hundred MB.
 */
const KEPT_BYTES = 64 * 2 ** 20;

/** Draws pictures, and keeps each layer's canvas so that one more stroke costs one stroke. */
export class PictureRaster {
  /** Least recently used first, as `bases`. */
  private readonly drawn = new Map<string, Drawn>();
  private readonly bases = new Map<string, ImageBitmap>();
  private readonly held = new Set<readonly (string | null)[]>();
  private live: LiveDrawing | null = null;
  private composed: Composed | null = null;

  constructor(
    private readonly size: Size,
    private readonly keptBytes = KEPT_BYTES,
  ) {}

  /** Pictures below strokes, by asset id; a layer whose base is missing shows its strokes only. */
  setBase(asset: string, picture: ImageBitmap): void {
    const before = this.bases.get(asset);
    if (before !== picture) before?.close();
    this.bases.set(asset, picture);
    for (const [id, drawn] of this.drawn) if (drawn.base === asset) this.drawn.delete(id);
  }

  /** Keep these bases until the returned function is called, whatever is drawn meanwhile. */
  hold(assets: readonly (string | null)[]): () => void {
    this.held.add(assets);
    return () => this.held.delete(assets);
  }

  hasBase(asset: string): boolean {
    return this.bases.has(asset);
  }

  /** The canvas of one layer, up to date. `key` is unique among the layers of all keys. */
  layer(key: string, layer: PictureLayer): HTMLCanvasElement {
    const known = this.drawn.get(key);
    const extends_ =
      known &&
      known.base === layer.base &&
      known.strokes.length <= layer.strokes.length &&
      known.strokes.every((stroke, i) => stroke === layer.strokes[i]);
    const drawn = known && extends_ ? known : this.begin(layer);
    for (const stroke of layer.strokes.slice(drawn.strokes.length)) this.add(drawn, stroke);
    drawn.strokes = layer.strokes;
    touch(this.drawn, key, drawn);
    return drawn.canvas;
  }

  /** Draw one more stroke; a smudge that was drawn under the pen is not drawn again, for that takes long. */
  private add({ canvas, context, strokes }: Drawn, stroke: Stroke): void {
    const live = this.live;
    if (stroke.kind !== "smudge" || live?.stroke.samples !== stroke.samples || live.on !== strokes) {
      drawStroke(context, stroke, this.size);
      return;
    }
    const whole = live.whole(canvas);
    context.globalCompositeOperation = "copy";
    context.drawImage(whole, 0, 0);
    context.globalCompositeOperation = "source-over";
    this.live = null;
  }

  private begin(layer: PictureLayer): Drawn {
    const [canvas, context] = createCanvas(this.size);
    const base = layer.base ? this.bases.get(layer.base) : undefined;
    if (layer.base && base) {
      context.drawImage(base, 0, 0, this.size.width, this.size.height);
      touch(this.bases, layer.base, base);
    }
    return { canvas, context, base: layer.base, strokes: [] };
  }

  /** Draw all visible layers. */
  draw(context: Context, key: string, picture: KeyPicture): void {
    this.compose(context, key, picture);
    this.forgetOthers(key, picture);
  }

  /**
   * The visible layers as one canvas, which stays the same object. `live`: the stroke under the pen, on top of its layer.
   * It is drawn again only if one of them has changed.
   */
  whole(key: string, picture: KeyPicture, live?: LiveStroke): HTMLCanvasElement {
    const layers = picture.layers.map((layer) => this.layer(`${key}/${layer.id}`, layer));
    const same =
      !live && this.composed?.picture === picture && layers.every((one, i) => one === this.composed?.layers[i]);
    const [canvas, context] = this.composed ? [this.composed.canvas, this.composed.context] : createCanvas(this.size);
    if (!same) {
      context.clearRect(0, 0, this.size.width, this.size.height);
      this.compose(context, key, picture, live);
      this.forgetOthers(key, picture);
    }
    this.composed = { canvas, context, picture: live ? null : picture, layers };
    return canvas;
  }

  /** Whether the picture hides everything below it. */
  covers(picture: KeyPicture): boolean {
    const [lowest] = picture.layers;
    return Boolean(
      lowest?.visible && lowest.opacity === 1 && lowest.base?.startsWith("frame:") && this.bases.has(lowest.base),
    );
  }

  private compose(context: Context, key: string, picture: KeyPicture, live?: LiveStroke): void {
    for (const layer of picture.layers) {
      if (!layer.visible) continue;
      context.globalAlpha = layer.opacity;
      const canvas = this.layer(`${key}/${layer.id}`, layer);
      context.drawImage(live?.layer === layer.id ? this.withLive(canvas, layer.strokes, live.stroke) : canvas, 0, 0);
    }
    context.globalAlpha = 1;
  }

  /** Drop what has not been used for longest, of other pictures only: a dropped base has to be loaded again. */
  private forgetOthers(key: string, picture: KeyPicture): void {
    const used = new Set([...picture.layers.map((layer) => layer.base), ...[...this.held].flat()]);
    const most = Math.floor(this.keptBytes / (4 * this.size.width * this.size.height));
    const canvases = [...this.drawn].filter(([id]) => !id.startsWith(`${key}/`));
    const pictures = [...this.bases].filter(([id]) => !used.has(id));
    for (const [id, { canvas }] of canvases.slice(0, Math.max(0, canvases.length - most / 2))) {
      canvas.width = 0; // frees its memory now, not at the next garbage collection
      this.drawn.delete(id);
    }
    for (const [id, base] of pictures.slice(0, Math.max(0, pictures.length - most / 2))) {
      base.close();
      this.bases.delete(id);
    }
  }

  /** The layer with the stroke under the pen. Only samples that are new since the last call are drawn. */
  private withLive(canvas: HTMLCanvasElement, on: readonly Stroke[], stroke: DrawnStroke): HTMLCanvasElement {
    if (this.live?.stroke !== stroke) {
      const whole = stroke.kind === "smudge" ? liveSmudge(stroke, this.size) : liveBrush(stroke, this.size);
      this.live = { stroke, on, whole };
    }
    return this.live.whole(canvas);
  }

  /** The finished picture as PNG, its longest side at most `side` px. */
  async small(key: string, picture: KeyPicture, side: number): Promise<Blob> {
    const scale = Math.min(1, side / Math.max(this.size.width, this.size.height));
    const shrunk = (length: number) => Math.max(1, Math.round(length * scale));
    const [canvas, context] = createCanvas({ width: shrunk(this.size.width), height: shrunk(this.size.height) });
    context.imageSmoothingQuality = "high";
    context.scale(canvas.width / this.size.width, canvas.height / this.size.height);
    this.draw(context, key, picture);
    return pngOf(canvas);
  }

  /** The finished picture as PNG. */
  async png(key: string, picture: KeyPicture): Promise<Blob> {
    const [canvas, context] = createCanvas(this.size);
    this.draw(context, key, picture);
    return pngOf(canvas);
  }
}

/** Put an entry at the end of a map: it is the most recently used one. */
function touch<K, V>(map: Map<K, V>, key: K, value: V): void {
  map.delete(key);
  map.set(key, value);
}

/** Drawing painted layers on canvases of the video's size. */

import { type Context, createCanvas } from "./canvas";
import { Compositor, drawVeil, isPlain } from "./compose";
import type { Size } from "./geometry";
import { pngOf } from "./png";
import { type Rect, unionOf } from "./rect";
import { boundsOf, drawStroke, type LiveDrawing, startLive } from "./stroke-drawing";
import { PaintBuffers } from "./stroke-mask";
import type { DrawnStroke, KeyPicture, PictureLayer, Stroke } from "./strokes";

export { createCanvas };

/** Pixels as they were before a stroke. */
interface Before {
  rect: Rect;
  canvas: HTMLCanvasElement;
}

interface Drawn {
  canvas: HTMLCanvasElement;
  context: Context;
  base: string | null;
  strokes: readonly Stroke[];
  /** Of the newest strokes, oldest first; null: the stroke changed nothing. */
  befores: (Before | null)[];
  /** Pixels that have changed since the layers were put together; null: none. */
  dirty: Rect | null;
}

/** The stroke under the pen; its samples grow in place. */
export interface LiveStroke {
  layer: string;
  stroke: DrawnStroke;
}

interface Composed {
  canvas: HTMLCanvasElement;
  context: Context;
  picture: KeyPicture;
  layers: readonly HTMLCanvasElement[];
  live: DrawnStroke | undefined;
}

interface Live {
  drawing: LiveDrawing;
  layer: HTMLCanvasElement;
  /** The strokes of the layer below it. */
  on: readonly Stroke[];
}

/**
 * Bytes of canvases and pictures that are kept, beside those of the picture that is drawn: four of each at 1080p. The
 * browser's decoder of a long 1080p video alone takes several hundred MB.
 */
const KEPT_BYTES = 64 * 2 ** 20;
/** Pixels of all layers that are kept to undo strokes without drawing all others again: 64 MB. */
const UNDO_PX = 16 * 2 ** 20;

/** Draws pictures, and keeps each layer's canvas so that one more stroke costs one stroke. */
export class PictureRaster {
  /** Least recently used first, as `bases`. */
  private readonly drawn = new Map<string, Drawn>();
  private readonly bases = new Map<string, ImageBitmap>();
  private readonly held = new Set<readonly (string | null)[]>();
  private live: Live | null = null;
  private composed: Composed | null = null;
  private readonly buffers: PaintBuffers;
  private readonly compositor: Compositor;
  /** What the last `whole` has changed; null: nothing. */
  changed: Rect | null = null;

  constructor(
    private readonly size: Size,
    private readonly keptBytes = KEPT_BYTES,
  ) {
    this.buffers = new PaintBuffers(size);
    this.compositor = new Compositor(size);
  }

  private get everything(): Rect {
    return { x: 0, y: 0, ...this.size };
  }

  /** Pictures below strokes, by asset id; a layer whose base is missing shows its strokes only. */
  setBase(asset: string, picture: ImageBitmap): void {
    const before = this.bases.get(asset);
    if (before !== picture) before?.close();
    this.bases.set(asset, picture);
    for (const [id, drawn] of this.drawn) if (drawn.base === asset) this.drawn.delete(id);
    if (this.composed) this.composed.layers = []; // it may be a mask of what is shown
  }

  /** Keep these bases until the returned function is called, whatever is drawn meanwhile. */
  hold(assets: readonly (string | null)[]): () => void {
    this.held.add(assets);
    return () => this.held.delete(assets);
  }

  drawBase(context: Context, asset: string): void {
    const base = this.bases.get(asset);
    if (base) context.drawImage(base, 0, 0, this.size.width, this.size.height);
  }

  hasBase(asset: string): boolean {
    return this.bases.has(asset);
  }

  /** The canvas of one layer, up to date. `key` is unique among the layers of all keys. */
  layer(key: string, layer: PictureLayer): HTMLCanvasElement {
    const known = this.drawn.get(key);
    const drawn = known && known.base === layer.base && takeBack(known, layer.strokes) ? known : this.begin(layer);
    for (const stroke of layer.strokes.slice(drawn.strokes.length)) this.add(drawn, stroke);
    drawn.strokes = layer.strokes;
    touch(this.drawn, key, drawn);
    return drawn.canvas;
  }

  /** Draw one more stroke; stamps and smudges that were drawn under the pen are not drawn again, for that takes long. */
  private add(drawn: Drawn, stroke: Stroke): void {
    const { canvas, context, strokes } = drawn;
    const rect = boundsOf(stroke, this.size);
    drawn.befores.push(rect && { rect, canvas: copyOf(canvas, rect) });
    const live = this.live;
    const same = "samples" in stroke && live?.drawing.stroke.samples === stroke.samples && live.on === strokes;
    if (same && rect && live.layer === canvas && (stroke.kind === "smudge" || stroke.tip)) {
      const shown = this.composed?.live === live.drawing.stroke;
      const rest = live.drawing.end();
      put(context, live.drawing.canvas, rect, rect.x, rect.y);
      this.live = null;
      if (shown && this.composed) this.composed.live = undefined;
      drawn.dirty = unionOf(drawn.dirty, shown ? rest : rect);
    } else {
      if (same) this.endLive();
      drawStroke(context, stroke, this.buffers);
      drawn.dirty = unionOf(drawn.dirty, rect);
    }
    drawn.strokes = [...strokes, stroke];
    this.forgetBefores();
  }

  private endLive(): void {
    this.live?.drawing.end();
    this.live = null;
  }

  /** Drop the oldest pixels that are kept for undoing. */
  private forgetBefores(): void {
    let room = UNDO_PX;
    for (const { befores } of [...this.drawn.values()].reverse()) {
      let keep = befores.length;
      while (keep > 0) {
        const { rect } = befores[keep - 1] ?? {};
        room -= rect ? rect.width * rect.height : 0;
        if (room < 0) break;
        keep -= 1;
      }
      befores.splice(0, keep);
    }
  }

  private begin(layer: PictureLayer): Drawn {
    const [canvas, context] = createCanvas(this.size);
    const base = layer.base ? this.bases.get(layer.base) : undefined;
    if (layer.base && base) {
      context.drawImage(base, 0, 0, this.size.width, this.size.height);
      touch(this.bases, layer.base, base);
    }
    return { canvas, context, base: layer.base, strokes: [], befores: [], dirty: this.everything };
  }

  /** Draw all visible layers. */
  draw(context: Context, key: string, picture: KeyPicture): void {
    this.compose(context, key, picture);
    this.forgetOthers(key, picture);
  }

  /**
   * The visible layers as one canvas, which stays the same object. `live`: the stroke under the pen, on top of its layer.
   * Only what has changed is drawn again; see `changed`.
   */
  whole(key: string, picture: KeyPicture, live?: LiveStroke): HTMLCanvasElement {
    const painted = paintedLayers(picture);
    const layers = painted.map((layer) => this.layer(`${key}/${layer.id}`, layer));
    const known = this.composed;
    const same = known && alike(known.picture, picture) && layers.every((one, i) => one === known.layers[i]);
    let changed = this.grow(painted, layers, live);
    if (known?.live && known.live !== live?.stroke) changed = unionOf(changed, boundsOf(known.live, this.size));
    for (const { id } of painted) {
      const drawn = this.drawn.get(`${key}/${id}`);
      changed = unionOf(changed, drawn?.dirty ?? null);
      if (drawn) drawn.dirty = null;
    }
    this.changed = same ? changed : this.everything;
    const [canvas, context] = known ? [known.canvas, known.context] : createCanvas(this.size);
    if (this.changed) {
      const { x, y, width, height } = this.changed;
      context.save();
      context.beginPath();
      context.rect(x, y, width, height);
      context.clip();
      context.clearRect(x, y, width, height);
      this.compose(context, key, picture, live);
      if (picture.mask) drawVeil(context, this.pixels(key, picture.mask, live));
      context.restore();
    }
    if (known?.picture !== picture) this.forgetOthers(key, picture);
    this.composed = { canvas, context, picture, layers, live: live?.stroke };
    return canvas;
  }

  /** Draw what is new of the stroke under the pen; the pixels that have changed. */
  private grow(painted: readonly PictureLayer[], layers: readonly HTMLCanvasElement[], live?: LiveStroke): Rect | null {
    const index = painted.findIndex(({ id }) => id === live?.layer);
    const [layer, canvas] = [painted[index], layers[index]];
    if (!live || !layer || !canvas) return null;
    const known = this.live;
    if (known?.drawing.stroke !== live.stroke || known.layer !== canvas || known.on !== layer.strokes) {
      this.endLive();
      this.live = { drawing: startLive(live.stroke, canvas, this.buffers), layer: canvas, on: layer.strokes };
    }
    return this.live?.drawing.grow() ?? null;
  }

  /** Whether the picture hides everything below it. */
  covers(picture: KeyPicture): boolean {
    const [lowest] = picture.layers;
    return Boolean(
      lowest &&
        isPlain(lowest) &&
        !lowest.strokes.some(({ kind }) => kind === "transform") &&
        lowest.base?.startsWith("frame:") &&
        this.bases.has(lowest.base),
    );
  }

  private compose(context: Context, key: string, picture: KeyPicture, live?: LiveStroke): void {
    this.compositor.draw(context, picture.layers, {
      canvas: (layer) => this.pixels(key, layer, live),
      mask: ({ mask }) => (mask ? this.bases.get(mask) : undefined),
    });
  }

  /** A layer, with the stroke under the pen if it is on it. */
  private pixels(key: string, layer: PictureLayer, live?: LiveStroke): HTMLCanvasElement {
    const canvas = this.layer(`${key}/${layer.id}`, layer);
    const grown = live?.layer === layer.id && this.live?.drawing.stroke === live.stroke;
    return grown ? (this.live?.drawing.canvas ?? canvas) : canvas;
  }

  /** Drop what has not been used for longest, of other pictures only: a dropped base has to be loaded again. */
  private forgetOthers(key: string, picture: KeyPicture): void {
    const used = new Set([...basesOf(picture), ...[...this.held].flat()]);
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

  /** The finished picture as PNG, its longest side at most `side` px. */
  async small(key: string, picture: KeyPicture, side: number): Promise<Blob> {
    const scale = Math.min(1, side / Math.max(this.size.width, this.size.height));
    const shrunk = (length: number) => Math.max(1, Math.round(length * scale));
    const [canvas, context] = createCanvas({ width: shrunk(this.size.width), height: shrunk(this.size.height) });
    const [whole, own] = createCanvas(this.size);
    this.draw(own, key, picture);
    if (picture.mask) {
      own.globalCompositeOperation = "destination-in";
      own.drawImage(this.layer(`${key}/${picture.mask.id}`, picture.mask), 0, 0);
    }
    context.imageSmoothingQuality = "high";
    context.drawImage(whole, 0, 0, canvas.width, canvas.height);
    return pngOf(canvas);
  }

  /** The finished picture as PNG. */
  async png(key: string, picture: KeyPicture): Promise<Blob> {
    const [canvas, context] = createCanvas(this.size);
    this.draw(context, key, picture);
    return pngOf(canvas);
  }

  /** The mask of a key as PNG: white where it has paint, on black. */
  async maskPng(key: string, mask: PictureLayer): Promise<Blob> {
    const [canvas, context] = createCanvas(this.size);
    context.drawImage(this.layer(`${key}/${mask.id}`, mask), 0, 0);
    for (const [how, color] of [
      ["source-in", "#fff"],
      ["destination-over", "#000"],
    ] as const) {
      Object.assign(context, { globalCompositeOperation: how, fillStyle: color });
      context.fillRect(0, 0, this.size.width, this.size.height);
    }
    return pngOf(canvas);
  }
}

/** The pictures that a key shows: those below strokes, and masks. */
export const basesOf = ({ layers, mask }: KeyPicture): (string | null)[] =>
  [...layers, ...(mask ? [mask] : [])].flatMap((layer) => [layer.base, layer.mask ?? null]);

/** What strokes are on: the layers but groups, and the key's mask. */
const paintedLayers = ({ layers, mask }: KeyPicture): readonly PictureLayer[] => [
  ...layers.filter(({ group }) => !group),
  ...(mask ? [mask] : []),
];

/** Put an entry at the end of a map: it is the most recently used one. */
function touch<K, V>(map: Map<K, V>, key: K, value: V): void {
  map.delete(key);
  map.set(key, value);
}

function copyOf(canvas: HTMLCanvasElement, { x, y, width, height }: Rect): HTMLCanvasElement {
  const [copy, context] = createCanvas({ width, height });
  context.drawImage(canvas, x, y, width, height, 0, 0, width, height);
  return copy;
}

/** Replace the pixels of a rectangle by those of `from` at (x, y). */
function put(context: Context, from: HTMLCanvasElement, rect: Rect, x: number, y: number): void {
  context.clearRect(rect.x, rect.y, rect.width, rect.height);
  context.drawImage(from, x, y, rect.width, rect.height, rect.x, rect.y, rect.width, rect.height);
}

/** Undo the strokes of a layer that are not among `wanted`; false: their pixels are not kept, or others are missing. */
function takeBack(drawn: Drawn, wanted: readonly Stroke[]): boolean {
  let same = 0;
  while (same < drawn.strokes.length && drawn.strokes[same] === wanted[same]) same += 1;
  const undone = drawn.strokes.length - same;
  if (undone > drawn.befores.length) return false;
  for (const before of drawn.befores.splice(drawn.befores.length - undone).reverse()) {
    if (!before) continue;
    put(drawn.context, before.canvas, before.rect, 0, 0);
    drawn.dirty = unionOf(drawn.dirty, before.rect);
  }
  if (undone) drawn.strokes = wanted.slice(0, same);
  return true;
}

/** Whether two pictures differ in nothing but the strokes of their layers. */
function alike(a: KeyPicture, b: KeyPicture): boolean {
  const settings = ({ strokes: _strokes, ...rest }: PictureLayer) => JSON.stringify(rest);
  const all = ({ layers, mask }: KeyPicture) => [...layers, ...(mask ? [mask] : [])];
  const [before, now] = [all(a), all(b)];
  return (
    a === b ||
    (before.length === now.length &&
      before.every((layer, i) => layer === now[i] || settings(layer) === settings(now[i] as PictureLayer)))
  );
}

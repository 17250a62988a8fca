/** Brush, eraser, smudge, fill and colour picker on the layers of a painted key. */

import { untracked } from "@preact/signals";
import { isAbort } from "../../api/http";
import { notify, notifyOf } from "../../ui/notices";
import { hexOf } from "../../ui/palette";
import { fillRuns } from "../drawing/fills";
import { random } from "../drawing/noise";
import { createCanvas, type LiveStroke } from "../drawing/raster";
import { Stabiliser } from "../drawing/stabiliser";
import {
  addStroke,
  type DrawnStroke,
  isNear,
  type KeyPicture,
  type PictureLayer,
  rounded,
  type Sample,
  type Stroke,
} from "../drawing/strokes";
import { prepareTip } from "../drawing/tip-shape";
import type { Store } from "../state/store";
import { type PointerSample, type StageTool, sampleOf } from "../state/tool";
import type { PaintedKeys } from "./keys";
import { MASK } from "./layer-edits";

const LEAST_DISTANCE_PX = 0.5;
/** How often a stroke under the pen is kept in this browser. */
const KEEP_MS = 500;
export const LOCKED = {
  title: "The layer's transparency is locked",
  message: "The eraser changes where a layer has paint.",
  remedy: "Clear “Lock transparency” of the layer, or choose another layer.",
};
const LABELS: Record<Stroke["kind"], string> = {
  brush: "Brush stroke",
  eraser: "Erase",
  smudge: "Smudge",
  fill: "Fill",
  transform: "Move",
};

export interface PaintTool extends StageTool {
  /** The key's picture and the stroke under the pen, for the stage to draw; null while the frame is not open. */
  shown(): { picture: KeyPicture; live: LiveStroke | undefined } | null;
  /** End the stroke under the pen, if there is one: the page is about to close. Resolves once all fills are done. */
  settle(): Promise<void>;
  /** The picture with the stroke under the pen, by `pictureKey`; empty without a stroke. */
  unfinished(): Record<string, KeyPicture>;
  /** The picture of the shown frame, once it is open, and its layer that is chosen; undefined: it cannot be painted on. */
  present(): KeyPicture | null;
  target(picture: KeyPicture): PictureLayer | undefined;
  /** What another tool shows in place of the picture. */
  adjust(picture: KeyPicture): KeyPicture;
  /** Load the frame's key, or prepare a new one, so that the first stroke is not delayed. */
  prepare(frame: number): void;
}

/** `keep` is called every half second while a stroke is drawn. */
export function createPaintTool(store: Store, keys: PaintedKeys, redraw: () => void, keep: () => void): PaintTool {
  let keeping = 0;
  let filling = Promise.resolve();
  let open: { key: string; picture: KeyPicture } | null = null;
  let live: LiveStroke | undefined;
  /** Samples of the stroke under the pen in their stored form, so that it is drawn the same way later. */
  let samples: Sample[] = [];
  /** The newest sample, if it is too near to the one before; the last one of a stroke is always kept. */
  let skipped: Sample | null = null;
  let stabiliser = new Stabiliser(0);
  /** Where the last stroke of a key has ended: with Shift, the next one begins there. */
  let ended: { key: string; sample: Sample } | null = null;
  /** With Shift, a straight line follows the pen. */
  let straight = false;

  async function prepare(frame: number): Promise<void> {
    const key = store.pictureKey(frame);
    if (store.tip) prepareTip(store.tip);
    const still = () => untracked(() => store.pictureKey(store.frame.value)) === key;
    try {
      const picture = await keys.open(frame, still, true);
      if (still()) open = { key, picture };
      redraw();
      if (still() && !store.presentResult(frame)) keys.bases.prepare(picture);
    } catch (error) {
      if (!isAbort(error)) notify(error);
    }
  }

  /** The present picture: the one in the history, else the one prepared for this frame. */
  function present(): KeyPicture | null {
    const frame = store.frame.value;
    const edited = keys.picture(frame);
    if (edited) return edited;
    return open?.key === store.pictureKey(frame) ? open.picture : null;
  }

  /** The layer to paint on: the chosen one, or the key's mask, else the topmost; of a group, its topmost. */
  function target({ layers, mask }: KeyPicture): PictureLayer | undefined {
    const id = store.paintLayer.value;
    if (mask && id === MASK) return mask;
    const chosen = layers.find((layer) => layer.id === id);
    if (chosen && !chosen.group) return chosen;
    const inside = layers.filter(({ group, parent }) => !group && (!chosen || parent === chosen.id));
    return inside.at(-1) ?? layers.findLast(({ group }) => !group);
  }

  /** Strokes on a layer whose transparency is locked keep it. */
  const locking = (layer: PictureLayer | null | undefined) => (layer?.locked ? { locked: true } : {});

  /** Act on the key and the layer to paint on: now, or once the key is open, if the user starts before that. */
  function whenOpen(act: (picture: KeyPicture, layer: PictureLayer) => void): void {
    const frame = store.frame.value;
    const key = store.pictureKey(frame);
    const on = (picture: KeyPicture) => {
      const layer = target(picture);
      if (layer) act(picture, layer);
    };
    const picture = present();
    if (picture) on(picture);
    else
      keys
        .open(frame, undefined, true)
        .then((opened) => {
          if (store.pictureKey(store.frame.value) === key) on(present() ?? opened);
        })
        .catch(notify);
  }

  function down(sample: PointerSample): boolean {
    const tool = store.tool.value;
    if (tool === "picker" || sample.alt) whenOpen((picture) => pick(picture, sample));
    else if (tool === "fill") whenOpen((picture, layer) => fill(picture, layer, sample));
    else if (tool === "eraser" && lockedTarget()) notifyOf(LOCKED);
    else begin(sample, tool === "eraser" || tool === "smudge" ? tool : "brush");
    return true;
  }

  function lockedTarget(): boolean {
    const picture = present();
    return Boolean(picture && target(picture)?.locked);
  }

  function begin(sample: PointerSample, kind: DrawnStroke["kind"]): void {
    const picture = present();
    const key = store.pictureKey(store.frame.value);
    const { drawing, view, tip } = store;
    if (drawing.view.value === "source") drawing.view.value = "key";
    const first = rounded(sampleOf(sample));
    samples = [first];
    straight = false;
    skipped = null;
    if (sample.shift && ended?.key === key) {
      samples = [ended.sample];
      [skipped, straight] = [first, true];
    }
    stabiliser = new Stabiliser(drawing.stabiliser.value / view.value.scale);
    stabiliser.to(first);
    const { size, opacity } = store.brush.value;
    const layer = picture && target(picture);
    const seed = Math.floor(2 ** 31 * random(10 * first[0], 10 * first[1], layer?.strokes.length ?? 0));
    const stroke = { size, opacity, samples, ...(tip && { tip, seed }), ...locking(layer) };
    live = {
      layer: layer?.id ?? "",
      stroke: kind === "smudge" ? { kind, ...stroke } : { kind, color: store.brushColor, ...stroke },
    };
    if (kind === "brush") drawing.used(store.brushColor);
    clearInterval(keeping);
    keeping = window.setInterval(keep, KEEP_MS);
    redraw();
  }

  function move(more: readonly PointerSample[]): void {
    if (!live) return;
    straight = Boolean(more.at(-1)?.shift);
    for (const pointed of more) {
      const pulled = stabiliser.to(rounded(sampleOf(pointed)));
      if (!pulled) continue;
      const sample = rounded(pulled);
      const last = samples.at(-1);
      skipped = pointed.shift || (last && isNear(last, sample, LEAST_DISTANCE_PX)) ? sample : null;
      if (!skipped) samples.push(sample);
    }
    if (straight) redraw();
  }

  function up(): void {
    clearInterval(keeping);
    const drawn = live;
    live = undefined;
    if (drawn) {
      const { stroke } = drawn;
      const last = stabiliser.end() ?? skipped;
      if (last) samples.push(last);
      ended = { key: store.pictureKey(store.frame.value), sample: samples.at(-1) as Sample };
      whenOpen((picture, layer) => commit(LABELS[stroke.kind], picture, drawn.layer || layer.id, stroke));
    }
    redraw();
  }

  /** The straight line that the pen is about to draw. */
  function draw(context: CanvasRenderingContext2D, px: number): void {
    const [from, to] = [samples.at(-1), stabiliser.end() ?? skipped];
    if (!live || !straight || !from || !to) return;
    for (const [color, width] of [
      ["#000", 3 * px],
      ["#fff", px],
    ] as const) {
      Object.assign(context, { strokeStyle: color, lineWidth: width });
      context.beginPath();
      context.moveTo(from[0], from[1]);
      context.lineTo(to[0], to[1]);
      context.stroke();
    }
  }

  function cancel(): void {
    clearInterval(keeping);
    live = undefined;
    redraw();
  }

  function commit(label: string, picture: KeyPicture, layer: string, stroke: Stroke): void {
    keys.edit(label, store.frame.value, addStroke(picture, layer, stroke));
  }

  /** A picture, or one of its layers alone. */
  function composite(
    picture: KeyPicture,
    only?: PictureLayer,
    key = store.pictureKey(store.frame.value),
  ): [HTMLCanvasElement, CanvasRenderingContext2D] {
    const [canvas, context] = createCanvas(store.size);
    if (only) context.drawImage(keys.raster.layer(`${key}/${only.id}`, only), 0, 0);
    else keys.raster.draw(context, key, picture);
    return [canvas, context];
  }

  /** Fills follow each other, and are on their frame also if another one is shown by the time their area is found. */
  function fill(picture: KeyPicture, { id }: PictureLayer, { at }: PointerSample): void {
    const { drawing, brush, brushColor: color } = store;
    const frame = store.frame.value;
    const key = store.pictureKey(frame);
    const options = drawing.fill.value;
    const { opacity } = brush.value;
    const run = async () => {
      const before = keys.picture(frame) ?? picture;
      const layer = before.mask?.id === id ? before.mask : before.layers.find((one) => one.id === id);
      if (!layer || store.pictureKey(frame) !== key) return;
      const [canvas] = composite(before, options.layerOnly ? layer : undefined, key);
      const runs = await fillRuns(canvas, at, options);
      const stroke: Stroke = { kind: "fill", color, opacity, runs, ...locking(layer) };
      const now = keys.picture(frame) ?? picture;
      if (runs.length && store.pictureKey(frame) === key) keys.edit(LABELS.fill, frame, addStroke(now, id, stroke));
    };
    drawing.used(color);
    store.filling.value += 1;
    filling = filling
      .then(run)
      .catch(notify)
      .finally(() => {
        store.filling.value -= 1;
      });
  }

  function pick(picture: KeyPicture, { at }: PointerSample): void {
    const [{ width, height }, context] = composite(picture);
    const { data } = context.getImageData(0, 0, width, height);
    const [x, y] = [Math.floor(at[0]), Math.floor(at[1])];
    if (x < 0 || y < 0 || x >= width || y >= height) return;
    const color = hexOf(data.slice(4 * (y * width + x), 4 * (y * width + x) + 3));
    store.brush.value = { ...store.brush.value, color };
  }

  return {
    cursor: "crosshair",
    down,
    move,
    up,
    cancel,
    draw,
    settle() {
      if (live) up();
      return filling;
    },
    unfinished() {
      const picture = live && present();
      const layer = picture && (live?.layer || target(picture)?.id);
      if (!live || !picture || !layer) return {};
      const key = store.pictureKey(store.frame.value);
      return { [key]: addStroke(picture, layer, { ...live.stroke, samples: [...samples] }) };
    },
    present,
    target,
    adjust: (picture) => picture,
    prepare: (frame) => void prepare(frame),
    shown() {
      const picture = present();
      return picture && { picture: this.adjust(picture), live };
    },
  };
}

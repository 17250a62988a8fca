/** Brush, eraser, smudge, fill and colour picker on the layers of a painted key. */

import { untracked } from "@preact/signals";
import { isAbort } from "../../api/http";
import { notify } from "../../ui/notices";
import { createCanvas, type LiveStroke } from "../drawing/raster";
import {
  addStroke,
  type DrawnStroke,
  floodRuns,
  isNear,
  type KeyPicture,
  type PictureLayer,
  rounded,
  type Sample,
  type Stroke,
} from "../drawing/strokes";
import type { Store } from "../state/store";
import { type PointerSample, type StageTool, sampleOf } from "../state/tool";
import type { PaintedKeys } from "./keys";

const FILL_TOLERANCE = 24;
const LEAST_DISTANCE_PX = 0.5;
/** How often a stroke under the pen is kept in this browser. */
const KEEP_MS = 500;
const LABELS: Record<Stroke["kind"], string> = {
  brush: "Brush stroke",
  eraser: "Erase",
  smudge: "Smudge",
  fill: "Fill",
};

export interface PaintTool extends StageTool {
  /** The key's picture and the stroke under the pen, for the stage to draw; null while the frame is not open. */
  shown(): { picture: KeyPicture; live: LiveStroke | undefined } | null;
  /** End the stroke under the pen, if there is one: the page is about to close. */
  settle(): void;
  /** The picture with the stroke under the pen, by `pictureKey`; empty without a stroke. */
  unfinished(): Record<string, KeyPicture>;
  /** Load the frame's key, or prepare a new one, so that the first stroke is not delayed. */
  prepare(frame: number): void;
}

/** `keep` is called every half second while a stroke is drawn. */
export function createPaintTool(store: Store, keys: PaintedKeys, redraw: () => void, keep: () => void): PaintTool {
  let keeping = 0;
  let open: { key: string; picture: KeyPicture } | null = null;
  let live: LiveStroke | undefined;
  /** Samples of the stroke under the pen in their stored form, so that it is drawn the same way later. */
  let samples: Sample[] = [];
  /** The newest sample, if it is too near to the one before; the last one of a stroke is always kept. */
  let skipped: Sample | null = null;

  async function prepare(frame: number): Promise<void> {
    const key = store.pictureKey(frame);
    const still = () => untracked(() => store.pictureKey(store.frame.value)) === key;
    try {
      const picture = await keys.open(frame, still, true);
      if (still()) open = { key, picture };
      redraw();
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

  /** The layer to paint on: the chosen one, else the topmost. */
  function target(picture: KeyPicture): PictureLayer | undefined {
    return picture.layers.find((layer) => layer.id === store.paintLayer.value) ?? picture.layers.at(-1);
  }

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
    else begin(sample, tool === "eraser" || tool === "smudge" ? tool : "brush");
    return true;
  }

  function begin(sample: PointerSample, kind: DrawnStroke["kind"]): void {
    const picture = present();
    samples = [rounded(sampleOf(sample))];
    skipped = null;
    const { color: _chosen, ...brush } = store.brush.value;
    const color = store.brushColor;
    const stroke: DrawnStroke = kind === "smudge" ? { kind, ...brush, samples } : { kind, color, ...brush, samples };
    live = { layer: (picture && target(picture)?.id) ?? "", stroke };
    clearInterval(keeping);
    keeping = window.setInterval(keep, KEEP_MS);
    redraw();
  }

  function move(more: readonly PointerSample[]): void {
    if (!live) return;
    for (const sample of more.map(sampleOf).map(rounded)) {
      const last = samples.at(-1);
      skipped = last && isNear(last, sample, LEAST_DISTANCE_PX) ? sample : null;
      if (!skipped) samples.push(sample);
    }
    redraw();
  }

  function up(): void {
    clearInterval(keeping);
    const drawn = live;
    live = undefined;
    if (drawn) {
      const { stroke } = drawn;
      if (skipped) samples.push(skipped);
      whenOpen((picture, layer) => commit(LABELS[stroke.kind], picture, drawn.layer || layer.id, stroke));
    }
    redraw();
  }

  function cancel(): void {
    clearInterval(keeping);
    live = undefined;
    redraw();
  }

  function commit(label: string, picture: KeyPicture, layer: string, stroke: Stroke): void {
    keys.edit(label, store.frame.value, addStroke(picture, layer, stroke));
  }

  function composite(picture: KeyPicture): ImageData {
    const [, context] = createCanvas(store.size);
    keys.raster.draw(context, store.pictureKey(store.frame.value), picture);
    return context.getImageData(0, 0, store.size.width, store.size.height);
  }

  function fill(picture: KeyPicture, layer: PictureLayer, { at }: PointerSample): void {
    const runs = floodRuns(composite(picture).data, store.size, at, FILL_TOLERANCE);
    const { opacity } = store.brush.value;
    const fill: Stroke = { kind: "fill", color: store.brushColor, opacity, runs };
    if (runs.length) commit(LABELS.fill, picture, layer.id, fill);
  }

  function pick(picture: KeyPicture, { at }: PointerSample): void {
    const { data, width, height } = composite(picture);
    const [x, y] = [Math.floor(at[0]), Math.floor(at[1])];
    if (x < 0 || y < 0 || x >= width || y >= height) return;
    const channels = [...data.slice(4 * (y * width + x), 4 * (y * width + x) + 3)];
    const color = `#${channels.map((value) => value.toString(16).padStart(2, "0")).join("")}`;
    store.brush.value = { ...store.brush.value, color };
  }

  return {
    cursor: "crosshair",
    down,
    move,
    up,
    cancel,
    settle: () => live && up(),
    unfinished() {
      const picture = live && present();
      const layer = picture && (live?.layer || target(picture)?.id);
      if (!live || !picture || !layer) return {};
      const key = store.pictureKey(store.frame.value);
      return { [key]: addStroke(picture, layer, { ...live.stroke, samples: [...samples] }) };
    },
    prepare: (frame) => void prepare(frame),
    shown() {
      const picture = present();
      return picture && { picture, live };
    },
  };
}

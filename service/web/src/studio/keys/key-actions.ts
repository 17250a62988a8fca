/** What is done with whole keys: imported, exported, copied, pasted, moved; and with layers: merged. */

import { Problem, saveFile } from "../../api/api";
import { notifyOf } from "../../ui/notices";
import { upload } from "../../ui/upload";
import {
  changeLayer,
  type Framed,
  type Layer,
  type PaintedKey,
  picturesOf,
  putAtFrame,
  removeAtFrame,
  withPart,
} from "../document/document";
import { createCanvas } from "../drawing/canvas";
import type { Size } from "../drawing/geometry";
import { pngOf } from "../drawing/png";
import { basesOf, PictureRaster } from "../drawing/raster";
import type { KeyPicture, KeySettings, PictureLayer } from "../drawing/strokes";
import { pictureAt, type Store } from "../state/store";
import { FRAME_LAYER, LOOK_LAYER, readPicture } from "./bases";
import { blank } from "./key-entries";
import { type PaintedKeys, paintLayer } from "./keys";
import { emptyLayer, freeId, MASK, mergePicture, withMerged } from "./layer-edits";
import { isPsd, makePsd, type RasterLayer, readLayers } from "./psd";
import { placed, type Scaling, sameSize } from "./scaling";

/** Asks how a picture of another size is laid on the frame; null: not at all. */
export type AskScaling = (name: string, picture: Size, frame: Size) => Promise<Scaling | null>;

/** A copied key; everything below its strokes is an asset, so that it looks the same at any frame of any project. */
export interface CopiedKey {
  size: Size;
  picture: KeyPicture;
  settings: KeySettings;
}

const COPIED = "impasto.copied-key";

export function readCopied(): CopiedKey | null {
  const text = localStorage.getItem(COPIED);
  return text ? JSON.parse(text) : null;
}

export class KeyActions {
  constructor(
    private readonly store: Store,
    private readonly keys: PaintedKeys,
    private readonly ask: AskScaling,
  ) {}

  // -- pictures that were painted elsewhere

  /** A picture becomes one layer of the key at a frame, a PSD keeps its layers. */
  async import(frame: number, file: File): Promise<void> {
    const key = this.store.pictureKey(frame);
    if (isPsd(file)) return this.importPsd(frame, file, key);
    const bitmap = await createImageBitmap(file).catch(() => {
      throw new Problem({ detail: `“${file.name}” is not a picture.`, remedy: "Use a PNG." });
    });
    const exact = sameSize(bitmap, this.store.size);
    const png = exact ? file : await this.scaled(file.name, bitmap);
    if (!png) return;
    const asset = await upload(png);
    this.keys.raster.setBase(asset.id, await createImageBitmap(png));
    this.keys.edit("Import a key", frame, { layers: [emptyLayer("import", file.name, asset.id), paintLayer()] }, key);
  }

  /** A picture of the video's size; null: the user wants none. */
  private async scaled(name: string, picture: ImageBitmap): Promise<File | null> {
    const scaling = await this.ask(name, picture, this.store.size);
    if (!scaling) return null;
    const canvas = this.onFrame(picture, picture, scaling);
    return new File([await pngOf(canvas)], `${name.replace(/\.[^.]*$/, "")}.png`, { type: "image/png" });
  }

  private onFrame(picture: CanvasImageSource, size: Size, scaling: Scaling): HTMLCanvasElement {
    const [canvas, context] = createCanvas(this.store.size);
    const { x, y, width, height } = placed(size, this.store.size, scaling);
    context.imageSmoothingQuality = "high";
    context.drawImage(picture, x, y, width, height);
    return canvas;
  }

  private async importPsd(frame: number, file: File, key: string): Promise<void> {
    const { size, layers, simplified } = await readLayers(file);
    await this.importLayers(file.name, frame, size, layers, key, "Import a key");
    if (!simplified.length) return;
    const names = simplified.map((name) => `“${name}”`).join(", ");
    notifyOf({
      title: "Some layers look different here",
      message: `These have effects, adjustments or blend modes that are not kept: ${names}.`,
      remedy: "Merge these layers in the other program, and import the file again.",
    });
  }

  /** Put raster layers of a picture of any size at a frame. `key`: its `pictureKey`. */
  private async importLayers(
    name: string,
    frame: number,
    size: Size,
    layers: readonly RasterLayer[],
    key: string,
    label: string,
    settings?: KeySettings,
  ): Promise<void> {
    const same = sameSize(size, this.store.size);
    const scaling = same ? "exact" : await this.ask(name, size, this.store.size);
    if (!scaling) return;
    const asset = async (canvas: HTMLCanvasElement | null, id: string): Promise<string | null> => {
      if (!canvas) return null;
      const own = same ? canvas : this.onFrame(canvas, size, scaling);
      const file = new File([await pngOf(own)], `key-${frame}-${id}.png`, { type: "image/png" });
      const found = await upload(file);
      this.keys.raster.setBase(found.id, await createImageBitmap(own));
      return found.id;
    };
    const made = layers.map(
      async ({
        id,
        name: title,
        canvas,
        mask,
        opacity,
        visible,
        blend,
        clip,
        locked,
        parent,
      }): Promise<PictureLayer> => ({
        ...emptyLayer(id, title, await asset(canvas, id)),
        mask: await asset(mask, `${id}-mask`),
        ...{ opacity, visible, blend, clip, locked, parent, group: !canvas },
      }),
    );
    const all = await Promise.all(made);
    const mask = all.find(({ id }) => id === MASK);
    const layersMade = [...all.filter((layer) => layer !== mask), paintLayer()];
    const picture = { layers: layersMade, ...(mask && { mask }), ...(settings && { settings }) };
    this.put(label, frame, picture, key);
    await this.keys.bases.load(picture); // those that were dropped while others were uploaded
  }

  // -- export

  private name(frame: number, suffix: string): string {
    return `${this.store.document.value.name}-frame-${String(frame).padStart(5, "0")}.${suffix}`;
  }

  async exportPng(frame: number): Promise<void> {
    saveFile(await this.keys.png(frame), this.name(frame, "png"));
  }

  async exportPsd(frame: number): Promise<void> {
    saveFile(await this.psd(frame), this.name(frame, "psd"));
  }

  /** All keys of the layer as one zip file; PNGs have the names by which a job takes them as its input. */
  async exportAll(frames: readonly number[], kind: "png" | "psd"): Promise<void> {
    const { zip } = await import("fflate");
    const files: Record<string, Uint8Array> = {};
    for (const frame of frames) {
      const made = kind === "png" ? await this.keys.png(frame) : await this.psd(frame);
      files[`${String(frame).padStart(7, "0")}.${kind}`] = new Uint8Array(await made.arrayBuffer());
    }
    const packed = await new Promise<Uint8Array<ArrayBuffer>>((done, fail) =>
      zip(files, { level: 0 }, (error, data) => (error ? fail(error) : done(data as Uint8Array<ArrayBuffer>))),
    );
    saveFile(new Blob([packed], { type: "application/zip" }), `${this.store.document.value.name}-keys-${kind}.zip`);
  }

  private async psd(frame: number): Promise<Blob> {
    const key = this.store.pictureKey(frame);
    const picture = await this.keys.open(frame);
    return this.keys.bases.with(picture, async () => {
      const [whole, context] = createCanvas(this.store.size);
      this.keys.raster.draw(context, key, picture);
      return makePsd(this.store.size, rasterLayers(this.keys.raster, this.store.size, key, picture.layers), whole);
    });
  }

  // -- copied, pasted, moved

  /** Copy the key of a frame, for any frame of any shot or project. */
  async copy(frame: number): Promise<void> {
    const picture = await this.fixed(await this.keys.open(frame));
    const { before, after, weight } = this.keys.stored<PaintedKey>(frame) ?? {};
    const copied: CopiedKey = {
      size: this.store.size,
      picture,
      settings: { before: before ?? null, after: after ?? null, weight: weight ?? 1 },
    };
    localStorage.setItem(COPIED, JSON.stringify(copied));
  }

  /** The picture with an asset below the strokes of each layer, in place of the video's own frame. */
  private async fixed(picture: KeyPicture): Promise<KeyPicture> {
    const layers: PictureLayer[] = [];
    for (const layer of picture.layers) {
      const base = layer.base && (await this.keys.bases.fixed(layer.base));
      const id = layer.id === FRAME_LAYER ? freeId({ layers: [...picture.layers, ...layers] }, LOOK_LAYER) : layer.id;
      layers.push(base === layer.base ? layer : { ...layer, id, base });
    }
    if (!picture.mask?.base) return { ...picture, layers };
    return { ...picture, layers, mask: { ...picture.mask, base: await this.keys.bases.fixed(picture.mask.base) } };
  }

  /** Put the copied key at a frame. */
  async paste(frame: number): Promise<void> {
    const copied = readCopied();
    if (!copied) throw new Problem({ detail: "No key has been copied.", remedy: "Copy a key first." });
    const key = this.store.pictureKey(frame);
    const { picture, size, settings } = copied;
    if (sameSize(size, this.store.size)) {
      await this.keys.bases.load(picture);
      this.put("Paste a key", frame, { ...picture, settings }, key);
      return;
    }
    const raster = new PictureRaster(size);
    for (const base of basesOf(picture)) if (base) raster.setBase(base, await readPicture(base));
    const all = [...picture.layers, ...(picture.mask ? [picture.mask] : [])];
    const layers = rasterLayers(raster, size, "copied", all);
    await this.importLayers("The copied key", frame, size, layers, key, "Paste a key", settings);
  }

  /** Put a picture at a frame, with its settings if it has some. */
  private put(label: string, frame: number, picture: KeyPicture, key: string): void {
    const { settings } = picture;
    const { part, ...place } = pictureAt(key);
    const changed = (entry: PaintedKey) => (entry.frame === frame ? { ...entry, ...settings } : entry);
    const change = (layer: Layer) => withPart(layer, part, picturesOf<PaintedKey>(layer, part).map(changed));
    this.store.edit(label, ({ document, pictures }) => ({
      document: settings ? changeLayer(document, place, change) : document,
      pictures: { ...pictures, [key]: picture },
    }));
  }

  /** Move a key to another frame, or put a copy of it there. */
  async carry(from: number, to: number, copy: boolean): Promise<void> {
    if (!copy) return this.move(from, to);
    await this.copy(from);
    await this.paste(to);
    this.store.goTo(to);
  }

  /** Move the key of a frame to another one, in place of the key that is there. */
  async move(from: number, to: number): Promise<void> {
    const { store, keys } = this;
    const section = store.section("keys");
    if (!section || from === to) return;
    const [before, after] = [store.pictureKey(from, section), store.pictureKey(to, section)];
    const picture = await this.fixed(await keys.open(from));
    const place = store.place;
    store.edit("Move a key", ({ document, pictures }) => {
      const { [before]: _moved, ...others } = pictures;
      const change = (layer: Layer) => {
        const all = picturesOf<Framed>(layer, section.part);
        const own = all.find((entry) => entry.frame === from);
        const rest = removeAtFrame(removeAtFrame(all, from), to);
        return withPart(layer, section.part, own ? putAtFrame(rest, { ...own, frame: to }) : rest);
      };
      return { document: changeLayer(document, place, change), pictures: { ...others, [after]: picture } };
    });
    if (store.frame.value === from) store.goTo(to);
  }

  /** Change the reach or the weight of a stored key. */
  set(frame: number, settings: Partial<KeySettings>, group = `key-settings-${frame}`): void {
    const part = this.store.section("keys")?.part;
    if (!part || !this.keys.stored(frame)) return;
    this.store.editPart<readonly PaintedKey[]>(
      "Change the reach of a key",
      part,
      (all) => all.map((entry) => (entry.frame === frame ? { ...entry, ...settings } : entry)),
      group,
    );
  }

  // -- layers

  /** Merge a layer with the one below it, or the layers of a group. */
  async merge(frame: number, id: string): Promise<void> {
    const key = this.store.pictureKey(frame);
    const picture = await this.keys.open(frame);
    const both = mergePicture(picture, id);
    if (!both) return;
    const asset = await this.keys.bases.with(both, async () => {
      const [canvas, context] = createCanvas(this.store.size);
      this.keys.raster.draw(context, key, both);
      const png = await pngOf(canvas);
      const found = await upload(new File([png], `key-${frame}-merged.png`, { type: "image/png" }));
      this.keys.raster.setBase(found.id, await createImageBitmap(canvas));
      return found.id;
    });
    if (this.keys.picture(frame) && this.keys.picture(frame) !== picture)
      throw new Problem({ detail: "The key has changed while its layers were merged.", remedy: "Merge them again." });
    this.keys.edit("Merge layers", frame, withMerged(picture, id, asset), key);
  }

  /** Lay the key over the painted frame as the film has it without the key, over the video's frame, or over nothing. */
  async setBase(frame: number, kind: "look" | "frame" | "none"): Promise<void> {
    const picture = await this.keys.open(frame);
    const [lowest, ...others] = picture.layers;
    const had = lowest && [FRAME_LAYER, LOOK_LAYER].includes(lowest.id);
    const rest = had ? others : picture.layers;
    const [video] = blank(this.store.layer.value.id, frame, false).layers;
    const made = { look: [this.keys.lookLayer(frame)], frame: video ? [video] : [], none: [] }[kind];
    const layers = [...made, ...rest];
    const next = { ...picture, layers: layers.length ? layers : [paintLayer()] };
    await this.keys.bases.load(next);
    this.keys.edit("Change what is below the paint", frame, next);
  }
}

/** The layers of a picture as canvases. */
function rasterLayers(raster: PictureRaster, size: Size, key: string, layers: readonly PictureLayer[]): RasterLayer[] {
  return layers.map((layer): RasterLayer => {
    const { id, name, opacity, visible, blend = "over", clip = false, locked = false, parent = null } = layer;
    const drawn = (draw: (context: CanvasRenderingContext2D) => void) => {
      const [canvas, context] = createCanvas(size);
      draw(context);
      return canvas;
    };
    return {
      ...{ id, name, opacity, visible, blend, clip, locked, parent },
      canvas: layer.group ? null : drawn((context) => context.drawImage(raster.layer(`${key}/${id}`, layer), 0, 0)),
      mask: layer.mask ? drawn((context) => raster.drawBase(context, layer.mask ?? "")) : null,
    };
  });
}

/** Painted keys, and marks: their editable pictures, their upload, and their entries in the document. */

import { effect } from "@preact/signals";
import * as api from "../../api/api";
import type { Asset, Section } from "../../api/schemas";
import { upload } from "../../ui/upload";
import { isPassing } from "../document/autosave";
import {
  addAsset,
  changeLayer,
  type Framed,
  type FrameImage,
  type Layer,
  type LayerPlace,
  layerOf,
  type PaintedKey,
  type PaintLayer,
  type ProjectDocument,
  picturesOf,
  putAtFrame,
  removeAtFrame,
  shotOf,
  stemOf,
  withPart,
} from "../document/document";
import { rewrite } from "../document/undo";
import { pngOf } from "../drawing/png";
import { createCanvas, PictureRaster } from "../drawing/raster";
import type { KeyPicture, PictureLayer, Stroke } from "../drawing/strokes";
import type { FrameSource } from "../previews/frames";
import { pictureAt, type State, type Store } from "../state/store";
import { Bases, baseOf, FRAME_LAYER } from "./bases";
import type { RasterLayer } from "./psd";

const PAINT_LAYER = "paint";
/** Later than the frames around a key, which need the processors first; see `neighbours.ts`. */
const REST_MS = 600;
const RETRY_MS = 3000;

export class PaintedKeys {
  readonly raster: PictureRaster;
  private readonly uploaded = new WeakSet<KeyPicture>();
  private readonly bases: Bases;
  private readonly dispose: () => void;
  private timer = 0;
  private running: Promise<void> = Promise.resolve();

  constructor(
    private readonly store: Store,
    frames: FrameSource,
    private readonly onproblem: (problem: api.Problem) => void,
  ) {
    this.raster = new PictureRaster(store.size);
    this.bases = new Bases(store, frames, this.raster);
    this.dispose = effect(() => {
      const { pictures } = store.history.value.present;
      const pending = Object.values(pictures).filter((picture) => !this.uploaded.has(picture)).length;
      store.uploading.value = pending;
      clearTimeout(this.timer);
      if (pending) this.timer = window.setTimeout(() => this.flush(), REST_MS);
    });
  }

  close(): void {
    this.dispose();
    clearTimeout(this.timer);
  }

  /** The editable picture of the selected layer at a frame, if it is open. */
  picture(frame: number): KeyPicture | undefined {
    return this.store.history.value.present.pictures[this.store.pictureKey(frame)];
  }

  /** What the document has at a frame, in the part that is painted on. */
  private stored<Item extends Framed>(frame: number): Item | undefined {
    const entries = picturesOf<Item>(this.store.layer.value, this.store.painted()?.part);
    return entries.find((entry) => entry.frame === frame);
  }

  /**
   * Open a frame: its key's layers, or a new picture over the video's frame; with `look`, over the painting of the frame
   * that the stage shows, so that the first stroke does not take it away.
   *
   * `wanted`: false once no caller waits for the key; an AbortError is then thrown, and loading ends.
   */
  async open(frame: number, wanted?: () => boolean, look = false): Promise<KeyPicture> {
    const known = this.picture(frame);
    const layer = this.store.layer.value.id;
    const marks = this.store.painted()?.editor === "marks";
    const isStored = this.stored(frame) !== undefined;
    const stored = marks ? this.readMarks(frame) : this.read(layer, frame);
    const overLook = async () => (look && !marks && (await this.overLook(layer, frame))) || blank(layer, frame, marks);
    const picture = known ?? (await stored) ?? (await overLook());
    await this.bases.load(picture, wanted);
    if (!known && isStored) this.uploaded.add(picture);
    return picture;
  }

  /** A new picture over the painting of the frame that the stage shows; null: it shows none. */
  private async overLook(layer: string, frame: number): Promise<KeyPicture | null> {
    const { store } = this;
    const shown = store.results.peek().get(frame);
    const own = (shown?.layer ?? layer) === layer && (shown?.layer || store.shot.peek().layers.length === 1);
    const present = shown?.final && own && shown.document === store.document.peek();
    if (!present || store.stageView.peek() === "source") return null;
    const [canvas, context] = createCanvas(store.size);
    context.imageSmoothingQuality = "high";
    context.drawImage(shown.picture, 0, 0, canvas.width, canvas.height);
    try {
      return await this.over(frame, await pngOf(canvas));
    } catch (error) {
      if (isPassing(api.asProblem(error))) return null; // without the service: over the video's frame
      throw error;
    }
  }

  /** A new picture over a painted frame. */
  private async over(frame: number, painted: Blob): Promise<KeyPicture> {
    const asset = await upload(new File([painted], `frame-${frame}.png`, { type: "image/png" }));
    this.raster.setBase(asset.id, await createImageBitmap(painted));
    return { layers: [emptyLayer("result", "Painted frame", asset.id), emptyLayer(PAINT_LAYER, "Paint", null)] };
  }

  private async readMarks(frame: number): Promise<KeyPicture | undefined> {
    const marks = this.stored<FrameImage>(frame);
    if (!marks) return undefined;
    const { assets } = this.store.document.value;
    const strokes = assets[marks.strokes ?? ""]?.id;
    const base = strokes ? null : (assets[marks.image]?.id ?? null);
    return {
      layers: [{ ...emptyLayer(PAINT_LAYER, "Paint", base), strokes: strokes ? await readStrokes(strokes) : [] }],
    };
  }

  /** The editable form of a stored key. */
  private async read(layer: string, frame: number): Promise<KeyPicture | undefined> {
    const key = this.stored<PaintedKey>(frame);
    if (!key) return undefined;
    const document = this.store.document.value;
    const id = (name: string | undefined | null) => (name ? (document.assets[name]?.id ?? null) : null);
    const stored = key.paint?.layers ?? [];
    if (!stored.length) return { layers: [emptyLayer(PAINT_LAYER, "Paint", id(key.image))] };
    const layers = stored.map(async (one): Promise<PictureLayer> => {
      const strokes = id(one.strokes);
      return {
        id: one.id,
        name: one.name ?? "",
        opacity: one.opacity ?? 1,
        visible: one.visible ?? true,
        base: one.id === FRAME_LAYER ? baseOf(layer, frame) : id(one.image),
        strokes: strokes ? await readStrokes(strokes) : [],
      };
    });
    return { layers: await Promise.all(layers) };
  }

  /** One step that changes a picture. `key`: its `pictureKey` when a slow step began. */
  edit(label: string, frame: number, picture: KeyPicture, key = this.store.pictureKey(frame)): void {
    this.store.edit(label, (state) => ({ ...state, pictures: { ...state.pictures, [key]: picture } }));
  }

  /** Put a picture that was painted elsewhere, of exactly the video's size, at a frame. */
  async import(frame: number, file: File): Promise<void> {
    const key = this.store.pictureKey(frame);
    const { width, height } = this.store.size;
    const picture = await createImageBitmap(file).catch(() => {
      throw new api.Problem({ detail: `“${file.name}” is not a picture.`, remedy: "Use a PNG." });
    });
    if (picture.width !== width || picture.height !== height) {
      throw new api.Problem({
        title: "The picture has another size",
        detail: `“${file.name}” has ${picture.width} × ${picture.height} pixels, the video has ${width} × ${height}.`,
        remedy: "Export the frame here, paint on it, and keep its size.",
      });
    }
    const asset = await upload(file);
    this.raster.setBase(asset.id, picture);
    const layers = [emptyLayer("import", file.name, asset.id), emptyLayer(PAINT_LAYER, "Paint", null)];
    this.edit("Import a key", frame, { layers }, key);
  }

  /** Put raster layers that were painted elsewhere, from back to front, at a frame. `key`: its `pictureKey`. */
  async importLayers(frame: number, layers: readonly RasterLayer[], key: string): Promise<void> {
    const made = layers.map(async ({ name, canvas, opacity, visible }, i): Promise<PictureLayer> => {
      const asset = await upload(new File([await pngOf(canvas)], `key-${frame}-layer-${i}.png`, { type: "image/png" }));
      this.raster.setBase(asset.id, await createImageBitmap(canvas));
      return { ...emptyLayer(`import-${i}`, name.slice(0, 200), asset.id), opacity, visible };
    });
    const layersMade = await Promise.all(made);
    this.edit("Import a key", frame, { layers: [...layersMade, emptyLayer(PAINT_LAYER, "Paint", null)] }, key);
    await this.bases.load({ layers: layersMade }); // those that were dropped while others were uploaded
  }

  /** The layers of a frame's picture in drawing order, from back to front, and the finished picture. */
  async layersOf(frame: number): Promise<{ layers: RasterLayer[]; whole: HTMLCanvasElement }> {
    const key = this.store.pictureKey(frame);
    const picture = await this.open(frame);
    return this.bases.with(picture, async () => this.drawnLayers(key, picture));
  }

  private drawnLayers(key: string, picture: KeyPicture): { layers: RasterLayer[]; whole: HTMLCanvasElement } {
    const layers = picture.layers.map(({ id, name, opacity, visible }, i) => {
      const [canvas, context] = createCanvas(this.store.size);
      const layer = picture.layers[i];
      if (layer) context.drawImage(this.raster.layer(`${key}/${id}`, layer), 0, 0);
      return { name, canvas, opacity, visible };
    });
    const [whole, context] = createCanvas(this.store.size);
    this.raster.draw(context, key, picture);
    return { layers, whole };
  }

  /** Make a painted frame the lowest layer of a key, to be corrected by hand. `key`: its `pictureKey`. */
  async correct(frame: number, painted: Blob, key: string): Promise<void> {
    this.edit("Correct a frame", frame, await this.over(frame, painted), key);
  }

  /** Remove the picture of a frame from the part that a section edits. */
  remove(frame: number, section: Section): void {
    const key = this.store.pictureKey(frame, section);
    const place = this.store.place;
    this.store.edit("Remove a key", ({ document, pictures }) => {
      const { [key]: _removed, ...rest } = pictures;
      const change = (layer: Layer) =>
        withPart(layer, section.part, removeAtFrame(picturesOf(layer, section.part), frame));
      return { document: changeLayer(document, place, change), pictures: rest };
    });
  }

  /** The finished picture of a frame as PNG: its key, or the video's frame. */
  async png(frame: number): Promise<Blob> {
    const key = this.store.pictureKey(frame);
    const picture = await this.open(frame);
    return this.bases.with(picture, () => this.raster.png(key, picture));
  }

  /** A picture of the selected layer as PNG, its longest side at most `side` px. */
  async small(frame: number, picture: KeyPicture, side: number): Promise<Blob> {
    const key = this.store.pictureKey(frame);
    return this.bases.with(picture, () => this.raster.small(key, picture, side));
  }

  /** Upload every painted key that has changed; resolves when all are in the document. */
  flush(): Promise<void> {
    clearTimeout(this.timer);
    this.running = this.running
      .then(() => this.uploadAll())
      .then(
        () => {
          this.store.uploadsWait.value = false;
        },
        (error) => this.failed(api.asProblem(error)),
      );
    return this.running;
  }

  /** Try again later if that may help. */
  private failed(problem: api.Problem): void {
    this.store.uploadsWait.value = isPassing(problem);
    if (isPassing(problem)) this.timer = window.setTimeout(() => this.flush(), RETRY_MS);
    else this.onproblem(problem);
  }

  /** Pictures that are not uploaded yet. */
  pending(): Record<string, KeyPicture> {
    const all = Object.entries(this.store.history.value.present.pictures);
    return Object.fromEntries(all.filter(([, picture]) => !this.uploaded.has(picture)));
  }

  private async uploadAll(): Promise<void> {
    const { pictures } = this.store.history.value.present;
    for (const [key, picture] of Object.entries(pictures)) {
      if (this.uploaded.has(picture)) continue;
      await this.uploadOne(key, picture);
    }
    const now = this.store.history.value.present.pictures;
    if (Object.values(now).some((picture) => !this.uploaded.has(picture))) await this.uploadAll();
  }

  private async uploadOne(key: string, picture: KeyPicture): Promise<void> {
    const { layer, frame, part } = pictureAt(key);
    const png = await this.bases.with(picture, () => this.raster.png(key, picture));
    const image = await upload(new File([png], `key-${frame}.png`, { type: "image/png" }));
    const strokes = await Promise.all(picture.layers.map((one) => uploadStrokes(one, frame)));
    this.uploaded.add(picture);
    const place = { shot: this.store.shot.value.id, layer };
    this.store.history.value = rewrite(this.store.history.value, (state: State) =>
      state.pictures[key] === picture
        ? { ...state, document: this.withPicture(state.document, place, part, frame, picture, image, strokes) }
        : state,
    );
  }

  /** The document with the uploaded picture as a key or as marks of the layer. */
  private withPicture(
    document: ProjectDocument,
    place: LayerPlace,
    part: string,
    frame: number,
    picture: KeyPicture,
    image: Asset,
    strokes: readonly (Asset | null)[],
  ): ProjectDocument {
    const layer = layerOf(shotOf(document, place.shot), place.layer);
    const section = layer && this.store.painted(layer, part);
    if (!section) return document;
    const stem = stemOf(place, section.part, frame);
    const [next, entry] =
      section.editor === "marks"
        ? withMarks(document, stem, frame, image, strokes)
        : withKey(document, stem, frame, picture, image, strokes);
    const put = (one: Layer) => withPart(one, section.part, putAtFrame<Framed>(picturesOf(one, section.part), entry));
    return changeLayer(next, place, put);
  }
}

/** A new picture: marks have nothing below them, a key has the frame of the video. */
function blank(layer: string, frame: number, marks: boolean): KeyPicture {
  const paint = emptyLayer(PAINT_LAYER, "Paint", null);
  return { layers: marks ? [paint] : [emptyLayer(FRAME_LAYER, "Video frame", baseOf(layer, frame)), paint] };
}

/** Marks have one layer of strokes. */
function withMarks(
  document: ProjectDocument,
  stem: string,
  frame: number,
  image: Asset,
  strokes: readonly (Asset | null)[],
): [ProjectDocument, FrameImage] {
  const [withImage, name] = addAsset(document, stem, { id: image.id });
  const first = strokes.find((asset) => asset !== null);
  const [next, strokesName] = first ? addAsset(withImage, `${stem}-strokes`, { id: first.id }) : [withImage, null];
  return [next, { frame, image: name, strokes: strokesName }];
}

function withKey(
  document: ProjectDocument,
  stem: string,
  frame: number,
  picture: KeyPicture,
  image: Asset,
  strokes: readonly (Asset | null)[],
): [ProjectDocument, PaintedKey] {
  let [next, name] = addAsset(document, stem, { id: image.id });
  const layers = picture.layers.map((one, i): PaintLayer => {
    const entry: PaintLayer = { id: one.id, name: one.name, opacity: one.opacity, visible: one.visible };
    const stroke = strokes[i];
    if (stroke) [next, entry.strokes] = addAsset(next, `${stem}-strokes`, { id: stroke.id });
    if (one.base?.startsWith("ast_")) [next, entry.image] = addAsset(next, `${stem}-base`, { id: one.base });
    return entry;
  });
  return [next, { frame, image: name, paint: { layers } }];
}

async function uploadStrokes({ strokes }: PictureLayer, frame: number): Promise<Asset | null> {
  if (!strokes.length) return null;
  const text = JSON.stringify({ version: 1, strokes });
  return upload(new File([text], `key-${frame}-strokes.json`, { type: "application/json" }));
}

async function readStrokes(asset: string): Promise<readonly Stroke[]> {
  const answer = await api.request(api.paths.content(asset));
  return ((await answer.json()) as { strokes: Stroke[] }).strokes;
}

const emptyLayer = (id: string, name: string, base: string | null): PictureLayer => ({
  id,
  name,
  opacity: 1,
  visible: true,
  base,
  strokes: [],
});

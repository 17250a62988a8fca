/** Painted keys, and marks: their editable pictures, their upload, and their entries in the document. */

import { effect } from "@preact/signals";
import * as api from "../../api/api";
import type { Section } from "../../api/schemas";
import { upload } from "../../ui/upload";
import { isPassing } from "../document/autosave";
import {
  changeLayer,
  type Framed,
  type FrameImage,
  type Layer,
  type LayerPlace,
  layerOf,
  type PaintedKey,
  type ProjectDocument,
  picturesOf,
  putAtFrame,
  removeAtFrame,
  shotOf,
  stemOf,
  withPart,
} from "../document/document";
import { rewrite } from "../document/undo";
import { basesOf, PictureRaster } from "../drawing/raster";
import type { KeyPicture } from "../drawing/strokes";
import type { FrameSource } from "../previews/frames";
import type { State } from "../state/session";
import { pictureAt, type Store } from "../state/store";
import { Bases, LOOK_LAYER, lookOf } from "./bases";
import {
  blank,
  PAINT_LAYER,
  readKey,
  readMarks,
  type UploadedPicture,
  uploadAllStrokes,
  withKey,
  withMarks,
} from "./key-entries";
import { emptyLayer } from "./layer-edits";

/** Later than the frames around a key, which need the processors first; see `neighbours.ts`. */
const REST_MS = 600;
const RETRY_MS = 3000;

export class PaintedKeys {
  readonly raster: PictureRaster;
  readonly bases: Bases;
  private readonly dispose: () => void;
  private timer = 0;
  private running: Promise<void> = Promise.resolve();
  /** Number of painted frames that were taken as the base of a key. */
  private looks = 0;

  constructor(
    private readonly store: Store,
    frames: FrameSource,
    redraw: () => void,
    private readonly onproblem: (problem: api.Problem) => void,
  ) {
    this.raster = new PictureRaster(store.size);
    this.bases = new Bases(store, frames, this.raster, (base) => {
      this.outdated(base);
      redraw();
    });
    this.dispose = effect(() => {
      const pending = this.waiting().length;
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
  stored<Item extends Framed>(frame: number): Item | undefined {
    const entries = picturesOf<Item>(this.store.layer.value, this.store.painted()?.part);
    return entries.find((entry) => entry.frame === frame);
  }

  /**
   * Open a frame: its key's layers, or a new picture: over the video's frame; with `look`, over the painted frame as the
   * film has it, so that the first stroke does not take it away. The stage's own picture stands for it until it is
   * painted at full size. Over the video's frame, too, where the stage shows the original, or if the service paints none.
   *
   * `wanted`: false once no caller waits for the key; an AbortError is then thrown, and loading ends.
   */
  async open(frame: number, wanted?: () => boolean, look = false): Promise<KeyPicture> {
    const { store } = this;
    const known = this.picture(frame);
    const layer = store.layer.value.id;
    const marks = store.painted()?.editor === "marks";
    const entry = this.stored(frame);
    const over = look && !marks && this.hasLook && store.stageView.peek() !== "source";
    const made = () => (over ? { layers: [this.lookLayer(frame), paintLayer()] } : blank(layer, frame, marks));
    const read = marks
      ? (found: Framed) => readMarks(store.document.value, found as FrameImage)
      : (found: Framed) => readKey(store.document.value, layer, found as PaintedKey);
    const picture = known ?? (entry ? await read(entry) : made());
    await this.bases.load(picture, wanted);
    if (!known && entry) store.session.uploaded.add(picture);
    return picture;
  }

  /** Whether the service paints frames of the selected layer as they are in the film, without other layers. */
  get hasLook(): boolean {
    const { opacity = 1, blend = "over", matte } = this.store.layer.peek();
    const others = this.store.shot.peek().layers.length > 1;
    return this.store.previews.peek() && (!others || (opacity === 1 && blend === "over" && !matte));
  }

  /** A layer of the painted frame as the film has it without a key there. */
  lookLayer(frame: number) {
    return emptyLayer(LOOK_LAYER, "Painted frame", lookOf(this.store.layer.peek().id, frame, ++this.looks));
  }

  /** A new picture over a painted frame. */
  private async over(frame: number, painted: Blob): Promise<KeyPicture> {
    const asset = await upload(new File([painted], `frame-${frame}.png`, { type: "image/png" }));
    this.raster.setBase(asset.id, await createImageBitmap(painted));
    return { layers: [emptyLayer(LOOK_LAYER, "Painted frame", asset.id), paintLayer()] };
  }

  /** One step that changes a picture. `key`: its `pictureKey` when a slow step began. */
  edit(label: string, frame: number, picture: KeyPicture, key = this.store.pictureKey(frame)): void {
    this.store.edit(label, (state) => ({ ...state, pictures: { ...state.pictures, [key]: picture } }));
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

  /** Upload the pictures again that lie over this one, which has changed. */
  private outdated(base: string): void {
    const { present, past, future } = this.store.history.peek();
    const states = [present, ...[...past, ...future].flatMap(({ before, after }) => [before, after])];
    const over = new Set(states.flatMap(({ pictures }) => Object.values(pictures)));
    for (const picture of over) if (basesOf(picture).includes(base)) this.store.session.uploaded.delete(picture);
    if (this.waiting().length) this.flush();
  }

  /** Try again later if that may help. */
  private failed(problem: api.Problem): void {
    this.store.uploadsWait.value = isPassing(problem);
    if (isPassing(problem)) this.timer = window.setTimeout(() => this.flush(), RETRY_MS);
    else this.onproblem(problem);
  }

  /** Pictures of this shot that are not uploaded yet; those of others need their clips. */
  private waiting(): [string, KeyPicture][] {
    return Object.entries(this.store.session.pending()).filter(([key]) => pictureAt(key).shot === this.store.shotId);
  }

  private async uploadAll(): Promise<void> {
    for (const [key, picture] of this.waiting()) await this.uploadOne(key, picture);
    if (this.waiting().length) await this.uploadAll();
  }

  private async uploadOne(key: string, picture: KeyPicture): Promise<void> {
    const { shot, layer, frame, part } = pictureAt(key);
    const file = async (name: string, png: Blob) => upload(new File([png], `${name}.png`, { type: "image/png" }));
    const { mask } = picture;
    const uploaded = await this.bases.with(picture, async (): Promise<UploadedPicture> => {
      const found = new Map<string, string | null>();
      for (const base of basesOf(picture)) if (base) found.set(base, await this.bases.assetOf(base));
      return {
        image: await file(`key-${frame}`, await this.raster.png(key, picture)),
        mask: mask ? await file(`key-${frame}-mask`, await this.raster.maskPng(key, mask)) : null,
        strokes: await uploadAllStrokes(picture, frame),
        baseOf: ({ base }) => (base && found.get(base)) || null,
      };
    });
    this.bases.prepare(picture);
    this.store.session.uploaded.add(picture);
    const place = { shot, layer };
    this.store.history.value = rewrite(this.store.history.value, (state: State) =>
      state.pictures[key] === picture
        ? { ...state, document: this.withPicture(state.document, place, part, frame, picture, uploaded) }
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
    uploaded: UploadedPicture,
  ): ProjectDocument {
    const layer = layerOf(shotOf(document, place.shot), place.layer);
    const section = layer && this.store.painted(layer, part);
    if (!section) return document;
    const stem = stemOf(place, section.part, frame);
    const before = picturesOf<PaintedKey>(layer, section.part).find((entry) => entry.frame === frame);
    const [next, entry] =
      section.editor === "marks"
        ? withMarks(document, stem, frame, uploaded)
        : withKey(document, stem, frame, before, picture, uploaded);
    const put = (one: Layer) => withPart(one, section.part, putAtFrame<Framed>(picturesOf(one, section.part), entry));
    return changeLayer(next, place, put);
  }
}

export const paintLayer = () => emptyLayer(PAINT_LAYER, "Paint", null);

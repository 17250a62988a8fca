/** Painted keys and marks as the document has them: their entries, and the pictures that are edited. */

import * as api from "../../api/api";
import type { Asset } from "../../api/schemas";
import { upload } from "../../ui/upload";
import {
  addAsset,
  type FrameImage,
  type PaintedKey,
  type PaintLayer,
  type ProjectDocument,
} from "../document/document";
import { strokesOfText, textOfStrokes } from "../drawing/stroke-text";
import type { KeyPicture, PictureLayer, Stroke } from "../drawing/strokes";
import { baseOf, FRAME_LAYER, grayOf } from "./bases";
import { emptyLayer, MASK } from "./layer-edits";

export const PAINT_LAYER = "paint";

/** What a picture was uploaded as. */
export interface UploadedPicture {
  image: Asset;
  mask: Asset | null;
  /** Strokes by the layer's id. */
  strokes: ReadonlyMap<string, Asset>;
  /** Asset id of what is below the strokes of a layer; null: nothing, or the video's own frame. */
  baseOf(layer: PictureLayer): string | null;
}

/** Upload the strokes of all layers. */
export async function uploadAllStrokes(picture: KeyPicture, frame: number): Promise<Map<string, Asset>> {
  const layers = [...picture.layers, ...(picture.mask ? [picture.mask] : [])].filter(({ strokes }) => strokes.length);
  const found = layers.map(async ({ id, strokes }): Promise<[string, Asset]> => {
    return [
      id,
      await upload(new File([textOfStrokes(strokes)], `key-${frame}-strokes.json`, { type: "application/json" })),
    ];
  });
  return new Map(await Promise.all(found));
}

async function readStrokes(asset: string | null): Promise<readonly Stroke[]> {
  if (!asset) return [];
  const answer = await api.request(api.paths.content(asset));
  return strokesOfText(await answer.text());
}

/** A new picture: marks have nothing below them, a key has the frame of the video. */
export function blank(layer: string, frame: number, marks: boolean): KeyPicture {
  const paint = emptyLayer(PAINT_LAYER, "Paint", null);
  return { layers: marks ? [paint] : [emptyLayer(FRAME_LAYER, "Video frame", baseOf(layer, frame)), paint] };
}

/** Marks have one layer of strokes. */
export function withMarks(
  document: ProjectDocument,
  stem: string,
  frame: number,
  { image, strokes }: UploadedPicture,
): [ProjectDocument, FrameImage] {
  const [withImage, name] = addAsset(document, stem, { id: image.id });
  const [first] = strokes.values();
  const [next, strokesName] = first ? addAsset(withImage, `${stem}-strokes`, { id: first.id }) : [withImage, null];
  return [next, { frame, image: name, strokes: strokesName }];
}

/** `before`: the key's entry so far, whose reach and weight stay. */
export function withKey(
  document: ProjectDocument,
  stem: string,
  frame: number,
  before: PaintedKey | undefined,
  picture: KeyPicture,
  uploaded: UploadedPicture,
): [ProjectDocument, PaintedKey] {
  const {
    paint: _paint,
    mask: _mask,
    image: _image,
    ...settings
  } = before ?? { frame, image: "", ...picture.settings };
  let [next, image] = addAsset(document, stem, { id: uploaded.image.id });
  const name = (suffix: string, id: string | null | undefined): string | undefined => {
    if (!id) return undefined;
    const [with_, found] = addAsset(next, `${stem}-${suffix}`, { id });
    next = with_;
    return found;
  };
  const entryOf = (layer: PictureLayer): PaintLayer => {
    const { id, name: title, opacity, visible, blend, clip, locked, group, parent } = layer;
    const strokes = name("strokes", uploaded.strokes.get(id)?.id);
    const base = name("base", uploaded.baseOf(layer));
    const mask = name("mask", layer.mask);
    return {
      ...{ id, name: title, opacity, visible },
      ...(strokes && { strokes }),
      ...(base && { image: base }),
      ...(mask && { mask }),
      ...(blend && blend !== "over" && { blend }),
      ...(clip && { clip }),
      ...(locked && { locked }),
      ...(group && { group }),
      ...(parent && { parent }),
    };
  };
  const paint = { layers: picture.layers.map(entryOf), ...(picture.mask && { mask: entryOf(picture.mask) }) };
  const mask = name("mask", uploaded.mask?.id);
  return [next, { ...settings, frame, image, paint, ...(mask && { mask }) }];
}

/** The editable form of stored marks. */
export async function readMarks(document: ProjectDocument, marks: FrameImage): Promise<KeyPicture> {
  const strokes = document.assets[marks.strokes ?? ""]?.id ?? null;
  const base = strokes ? null : (document.assets[marks.image]?.id ?? null);
  return { layers: [{ ...emptyLayer(PAINT_LAYER, "Paint", base), strokes: await readStrokes(strokes) }] };
}

/** The editable form of a stored key of a layer of the document. */
export async function readKey(document: ProjectDocument, layer: string, key: PaintedKey): Promise<KeyPicture> {
  const id = (name: string | undefined | null) => (name ? (document.assets[name]?.id ?? null) : null);
  const read = async (one: PaintLayer): Promise<PictureLayer> => ({
    ...emptyLayer(one.id, one.name ?? "", one.id === FRAME_LAYER ? baseOf(layer, key.frame) : id(one.image)),
    opacity: one.opacity ?? 1,
    visible: one.visible ?? true,
    strokes: await readStrokes(id(one.strokes)),
    blend: one.blend ?? "over",
    clip: one.clip ?? false,
    locked: one.locked ?? false,
    group: one.group ?? false,
    parent: one.parent ?? null,
    mask: id(one.mask),
  });
  const stored = key.paint?.layers ?? [];
  const layers = stored.length
    ? await Promise.all(stored.map(read))
    : [emptyLayer(PAINT_LAYER, "Paint", id(key.image))];
  if (key.paint?.mask) return { layers, mask: { ...(await read(key.paint.mask)), id: MASK } };
  return key.mask ? { layers, mask: emptyLayer(MASK, "Mask", grayOf(id(key.mask) ?? "")) } : { layers };
}

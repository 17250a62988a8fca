/**
 * The project document (schema 2): its types, and pure functions that return a changed copy.
 *
 * Frames are indices into the shot's video, from 0; points are fractions of the picture's width and height, 0..1, y down;
 * angles are degrees clockwise from the right.
 */

import type { InputSpec, Params, Schemas } from "../../api/schemas";

export type AssetRef = Schemas["ProjectAssetRef"];
export type Point = [x: number, y: number];
export type Blend = NonNullable<Layer["blend"]>;
export type PaintLayer = Schemas["ProjectPaintLayer"];
export type PaintedKey = Schemas["ProjectPaintedKey"];
export type FrameImage = Schemas["ProjectDrawing"];
/** A corrected label map: gray value = cluster. `solve`: frames [first, end) that it changes; null: the shot. */
export type LabelCorrection = FrameImage & { solve?: [number, number] | null };

/** A layer. Its parts are described by the methods; `Section.part` names the one that an editor of the studio edits. */
export type Layer = Omit<Schemas["ProjectLayer"], "parts"> & { parts?: Readonly<Record<string, unknown>> };

export type Shot = Omit<Schemas["ProjectShot"], "layers"> & { layers: Layer[] };
export type Variant = Omit<Schemas["ProjectVariant"], "set"> & { set: { method?: string; params?: Params } };
export type ProjectDocument = Omit<Schemas["ProjectDocument"], "shots" | "variants" | "assets"> & {
  assets: Record<string, AssetRef>;
  shots: Shot[];
  variants?: Variant[];
};

/** A project with one shot of one layer. */
export function newDocument(name: string, videoAsset: string, method: string): ProjectDocument {
  return {
    schema: 2,
    name: name.slice(0, 200) || "Untitled",
    assets: { clip: { id: videoAsset, title: name } },
    shots: [{ id: "s1", video: "clip", layers: [{ id: "l1", method }] }],
  };
}

export const shotOf = (document: ProjectDocument, id: string): Shot | undefined =>
  document.shots.find((shot) => shot.id === id);
export const layerOf = (shot: Shot | undefined, id: string): Layer | undefined =>
  shot?.layers.find((layer) => layer.id === id);

/** The layer that the stage shows alone, because the film would not: undefined for all visible layers together. */
export function shownAlone(shot: Shot, layerId: string): string | undefined {
  const visible = shot.layers.filter((layer) => layer.visible !== false);
  return visible.some((layer) => layer.id === layerId) ? undefined : layerId;
}

/** Add an asset under a name that starts with `stem`, or find the name that it already has. */
export function addAsset(document: ProjectDocument, stem: string, ref: AssetRef): [ProjectDocument, string] {
  const known = Object.entries(document.assets).find(([, asset]) => asset.id === ref.id);
  if (known) return [document, known[0]];
  const name = freeName(stem, (candidate) => candidate in document.assets);
  return [{ ...document, assets: { ...document.assets, [name]: ref } }, name];
}

/** Start of the names of a part's assets, which have at most 80 characters. */
export const stemOf = (place: LayerPlace, part: string, frame: number): string =>
  `${`${place.layer}-${part}`.slice(0, 50)}-${frame}`;

/** `stem`, or `stem-2`, `stem-3`, ... */
export function freeName(stem: string, taken: (name: string) => boolean): string {
  for (let i = 1; ; i++) {
    const name = i === 1 ? stem : `${stem}-${i}`;
    if (!taken(name)) return name;
  }
}

/** Where a change belongs: a layer of a shot. */
export interface LayerPlace {
  shot: string;
  layer: string;
}

/** A copy with one layer changed; the rest of the document is shared. */
export function changeLayer(
  document: ProjectDocument,
  place: LayerPlace,
  change: (layer: Layer) => Layer,
): ProjectDocument {
  return changeShot(document, place.shot, (shot) => ({
    ...shot,
    layers: shot.layers.map((layer) => (layer.id === place.layer ? change(layer) : layer)),
  }));
}

export function changeShot(document: ProjectDocument, id: string, change: (shot: Shot) => Shot): ProjectDocument {
  return { ...document, shots: document.shots.map((shot) => (shot.id === id ? change(shot) : shot)) };
}

export interface Framed {
  frame: number;
}

/** The pictures of a part of the layer, in the order of frames. */
export const picturesOf = <Item extends Framed = FrameImage>(layer: Layer, part = ""): readonly Item[] =>
  (layer.parts?.[part] as readonly Item[] | undefined) ?? NONE;
const NONE: readonly never[] = [];

/** Names of the inputs that jobs of the layer have, besides the video: files, and what is made from the layer's parts. */
export const inputsOf = (layer: Layer, specs: readonly InputSpec[]): string[] =>
  specs.filter((spec) => spec.name in (layer.inputs ?? {}) || isDrawn(layer, spec)).map(({ name }) => name);

function isDrawn(layer: Layer, { kind, part }: InputSpec): boolean {
  if (!part) return false;
  if (kind === "json") return Object.keys(layer.parts?.[part] ?? {}).length > 0;
  const [name, member = ""] = part.split(".");
  return picturesOf<Framed & Record<string, unknown>>(layer, name).some((item) => item[member]);
}

export const withPart = (layer: Layer, part: string, value: unknown): Layer => ({
  ...layer,
  parts: { ...layer.parts, [part]: value },
});

/** The list with `item` in place of the one at its frame, in the order of frames. */
export function putAtFrame<Item extends Framed>(items: readonly Item[] = [], item: Item): Item[] {
  return [...items.filter((other) => other.frame !== item.frame), item].sort((a, b) => a.frame - b.frame);
}

export const removeAtFrame = <Item extends Framed>(items: readonly Item[] = [], frame: number): Item[] =>
  items.filter((item) => item.frame !== frame);

/** The newest key at or before a frame, or the first one. */
export function keyAt<Item extends Framed>(items: readonly Item[], frame: number): Item | undefined {
  return items.findLast((item) => item.frame <= frame) ?? items[0];
}

/** Asset names that the document refers to anywhere in its shots, or in styles saved with it. */
function usedAssets(document: ProjectDocument): Set<string> {
  const names = new Set<string>();
  const visit = (value: unknown): void => {
    if (typeof value === "string" && value in document.assets) names.add(value);
    else if (value && typeof value === "object") Object.values(value).forEach(visit);
  };
  visit(document.shots);
  visit(document.ui);
  return names;
}

/** Remove asset entries without references, so that the document does not grow with every brush stroke. */
export function pruneAssets(document: ProjectDocument): ProjectDocument {
  const used = usedAssets(document);
  const kept = Object.entries(document.assets).filter(([name]) => used.has(name));
  if (kept.length === Object.keys(document.assets).length) return document;
  return { ...document, assets: Object.fromEntries(kept) };
}

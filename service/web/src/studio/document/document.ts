/**
 * The project document (schema 1): its types, and pure functions that return a changed copy.
 *
 * Frames are indices into the shot's video, from 0; points are fractions of the picture's width and height, 0..1, y down;
 * angles are degrees clockwise from the right.
 */

import type { Params, Schemas } from "../../api/schemas";

export type AssetRef = Schemas["ProjectAssetRef"];
export type Point = [x: number, y: number];
export type Ease = "linear" | "smooth" | "in" | "out" | "hold";
export type Blend = NonNullable<Layer["blend"]>;
export type PaintLayer = Schemas["ProjectPaintLayer"];
export type PaintedKey = Schemas["ProjectPaintedKey"];
export type FrameImage = Schemas["ProjectDrawing"];
/** A corrected label map: gray value = cluster. */
export type LabelCorrection = Schemas["ProjectLabelMap"];

export interface Region {
  objects?: number[];
  tubes?: number[];
  polygons?: { frame: number; points: Point[] }[];
  label?: number;
  of?: string;
  border?: string;
}

export interface StyleKey {
  region: string;
  frame: number;
  style?: string;
  /** Parameters that differ from the style's. */
  set?: Params;
  ease?: Ease;
}

/**
 * Patterns of the method multistyle: regular = parallel strokes at an angle. The angle of a center, spiral or node turns each
 * stroke relative to the ray from the centre.
 */
export type Pattern = "regular" | "center" | "spiral" | "node" | "saddle" | "wedge" | "trisector";

export interface DirectionElement {
  pattern: Pattern;
  at: Point;
  /** Degrees. */
  angle?: number;
  /** Distance at which 37 % of the influence is left, in heights of the picture; 0 = everywhere. */
  reach?: number;
  strength?: number;
}

export interface DirectionKey {
  region: string;
  frame: number;
  elements: DirectionElement[];
  edge_weight?: number;
  follow?: boolean;
  free?: boolean;
  ease?: Ease;
}

/** The service passes regions, styles and directions on to the method as they are. */
export type Layer = Omit<
  Schemas["ProjectLayer"],
  "regions" | "styles" | "style_keys" | "directions" | "label_styles"
> & {
  regions?: Record<string, Region>;
  styles?: Record<string, Params>;
  style_keys?: StyleKey[];
  directions?: DirectionKey[];
  label_styles?: Record<string, string>;
};

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
    schema: 1,
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

interface Framed {
  frame: number;
}

/** The list with `item` in place of the one at its frame, in the order of frames. */
export function putAtFrame<Item extends Framed>(items: readonly Item[] = [], item: Item): Item[] {
  return [...items.filter((other) => other.frame !== item.frame), item].sort((a, b) => a.frame - b.frame);
}

export const removeAtFrame = <Item extends Framed>(items: readonly Item[] = [], frame: number): Item[] =>
  items.filter((item) => item.frame !== frame);

interface RegionFramed extends Framed {
  region: string;
}

/** The same for keys on the track of a region. */
export function putOnTrack<Item extends RegionFramed>(items: readonly Item[] = [], item: Item): Item[] {
  const others = items.filter((other) => other.frame !== item.frame || other.region !== item.region);
  return [...others, item].sort((a, b) => a.frame - b.frame || a.region.localeCompare(b.region));
}

export const removeFromTrack = <Item extends RegionFramed>(
  items: readonly Item[] = [],
  region: string,
  frame: number,
): Item[] => items.filter((item) => item.frame !== frame || item.region !== region);

/** Keys of one region, in the order of frames. */
export const trackOf = <Item extends RegionFramed>(items: readonly Item[] = [], region: string): Item[] =>
  items.filter((item) => item.region === region);

/** The newest key at or before a frame, or the first one. */
export function keyAt<Item extends Framed>(items: readonly Item[], frame: number): Item | undefined {
  return items.findLast((item) => item.frame <= frame) ?? items[0];
}

/** Move every key at a frame of a layer's track to another frame; a key already there is replaced. */
export function moveKeys(layer: Layer, track: "keys" | "style_keys" | "directions", from: number, to: number): Layer {
  if (from === to || to < 0) return layer;
  const moved = <Item extends Framed>(items: readonly Item[] = []): Item[] =>
    items
      .filter((item) => item.frame !== to)
      .map((item) => (item.frame === from ? { ...item, frame: to } : item))
      .sort((a, b) => a.frame - b.frame);
  if (track === "keys") return { ...layer, keys: moved(layer.keys) };
  if (track === "style_keys") return { ...layer, style_keys: moved(layer.style_keys) };
  return { ...layer, directions: moved(layer.directions) };
}

/** Remove a region with its keys and directions. */
export function removeRegion(layer: Layer, name: string): Layer {
  const { [name]: _removed, ...regions } = layer.regions ?? {};
  const others = <Item extends RegionFramed>(items: readonly Item[] = []) =>
    items.filter((item) => item.region !== name);
  return { ...layer, regions, style_keys: others(layer.style_keys), directions: others(layer.directions) };
}

/** Join several regions into the first: it gets all their objects, tubes and polygons. */
export function mergeRegions(layer: Layer, names: readonly string[]): Layer {
  const [first, ...rest] = names.filter((name) => layer.regions?.[name]);
  if (!first || !rest.length) return layer;
  const all = [first, ...rest].map((name) => layer.regions?.[name] ?? {});
  const merged: Region = { ...all[0] };
  const objects = [...new Set(all.flatMap((region) => region.objects ?? []))].sort((a, b) => a - b);
  const tubes = [...new Set(all.flatMap((region) => region.tubes ?? []))].sort((a, b) => a - b);
  const polygons = all.flatMap((region) => region.polygons ?? []);
  if (objects.length) merged.objects = objects;
  if (tubes.length) merged.tubes = tubes;
  if (polygons.length) merged.polygons = polygons;
  const kept = rest.reduce(removeRegion, layer);
  return { ...kept, regions: { ...kept.regions, [first]: merged } };
}

/** The tubes of a region, those of its objects included; `partsOf` gives the tubes of an object. */
export const tubesOf = (
  { objects = [], tubes = [] }: Region,
  partsOf: (object: number) => readonly number[],
): number[] => [...new Set([...tubes, ...objects.flatMap(partsOf)])].sort((a, b) => a - b);

/** A design document of the method multistyle. */
export interface Design {
  regions?: Record<string, Region>;
  keys?: StyleKey[];
  directions?: DirectionKey[];
}

/** The layer with another design, instead of its own and of the effect that its parameters name. */
export function withDesign(layer: Layer, { regions = {}, keys = [], directions = [] }: Design): Layer {
  const { effect: _effect, ...params } = layer.params ?? {};
  return { ...layer, params, regions, style_keys: keys, directions };
}

/** Take a tube out of a region and add it to the region `name`, which `splitRegion` has made of another part of it. */
export function moveTube(layer: Layer, owner: string, tube: number, name: string): Layer {
  const { [owner]: whole, [name]: part } = layer.regions ?? {};
  const left = whole?.tubes?.filter((other) => other !== tube) ?? [];
  if (!left.length || left.length === whole?.tubes?.length) return layer;
  const tubes = [...(part?.tubes ?? []), tube].sort((a, b) => a - b);
  return { ...layer, regions: { ...layer.regions, [owner]: { ...whole, tubes: left }, [name]: { ...part, tubes } } };
}

/** Remove a tube from a region: it becomes the region `name`, with the keys of the former region. */
export function splitRegion(
  layer: Layer,
  owner: string,
  tube: number,
  name: string,
  partsOf: (object: number) => readonly number[],
): Layer {
  const whole = layer.regions?.[owner] ?? {};
  const left = tubesOf(whole, partsOf).filter((other) => other !== tube);
  if (!left.length) return layer;
  const { objects: _objects, ...rest } = whole;
  const copied = <Item extends RegionFramed>(items: readonly Item[] = []): Item[] => [
    ...items,
    ...trackOf(items, owner).map((item) => ({ ...item, region: name })),
  ];
  return {
    ...layer,
    regions: { ...layer.regions, [owner]: { ...rest, tubes: left }, [name]: { tubes: [tube] } },
    style_keys: copied(layer.style_keys),
    directions: copied(layer.directions),
  };
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

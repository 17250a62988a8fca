/**
 * Looks: everything of a layer that is not tied to frames, to be used on other shots and in other projects. Pure functions
 * that return a changed copy of the document. A document keeps its looks in `ui.styles`.
 */

import type { Params } from "../../api/schemas";
import { type Design, putOnTrack, REST, trackOf } from "./design";
import { addAsset, changeLayer, type Layer, type LayerPlace, type ProjectDocument, withPart } from "./document";
import type { Tip } from "./tip";

/** The settings of a brush. */
export interface Brush {
  color: string;
  size: number;
  opacity: number;
  /** Of its stamps, and the name of the brush; without it: a plain round line. */
  tip?: Tip;
  name?: string;
}

/** The style of a region, by the region's name. */
export interface RegionLook {
  style?: string;
  set?: Params;
}

export interface Look {
  title: string;
  method: string;
  params: Params;
  seed?: number;
  /** The paintings: names of assets by input; ids of assets in a portable look. */
  inputs: Record<string, string>;
  /** Styles that were defined for regions, by their names. */
  styles?: Record<string, Params>;
  /** Of regions with these names. */
  regions?: Record<string, RegionLook>;
  brush?: Brush;
  /** What it looks like: the name of an asset; its id in a portable look. */
  picture?: string;
}

/** What tells a look of a layer from its drawings. */
export interface LookParts {
  /** Names of the inputs that hold paintings, of all methods. */
  paintings: readonly string[];
  /** The part with regions and their styles; empty: the method has none. */
  design: string;
}

export const looksOf = ({ ui }: ProjectDocument): Look[] =>
  Array.isArray(ui?.styles) ? (ui.styles as unknown as Look[]) : [];

export const withLooks = (document: ProjectDocument, looks: readonly Look[]): ProjectDocument => ({
  ...document,
  ui: { ...document.ui, styles: [...looks] as never },
});

/** The look of a layer: a region has the style of its first key. */
export function lookOf(title: string, layer: Layer, { paintings, design }: LookParts, brush?: Brush): Look {
  const { method, params = {}, seed, inputs = {} } = layer;
  const { styles, regions, keys } = (layer.parts?.[design] as Design | undefined) ?? {};
  const named = [...new Set([...Object.keys(regions ?? {}), ...(keys ?? []).map(({ region }) => region)])];
  const looks = named.flatMap((name): [string, RegionLook][] => {
    const { style, set } = trackOf(keys, name)[0] ?? {};
    return style || set ? [[name, { ...(style && { style }), ...(set && { set }) }]] : [];
  });
  return {
    title,
    method,
    params,
    inputs: Object.fromEntries(Object.entries(inputs).filter(([input]) => paintings.includes(input))),
    ...(seed && { seed }),
    ...(styles && Object.keys(styles).length && { styles }),
    ...(looks.length && { regions: Object.fromEntries(looks) }),
    ...(brush && { brush }),
  };
}

/** The same look with asset ids, which mean the same in every project; inputs without an asset are left out. */
export function portable(look: Look, document: ProjectDocument): Look {
  const { picture, ...rest } = look;
  const id = (name: string | undefined) => document.assets[name ?? ""]?.id;
  const inputs = Object.entries(look.inputs).flatMap(([input, name]) => {
    const found = id(name);
    return found ? [[input, found]] : [];
  });
  const shown = id(picture);
  return { ...rest, inputs: Object.fromEntries(inputs), ...(shown && { picture: shown }) };
}

/** A portable look as this document names its assets. */
export function adopted(document: ProjectDocument, { picture, ...look }: Look): [ProjectDocument, Look] {
  let next = document;
  const named = (stem: string, id: string): string => {
    const [changed, name] = addAsset(next, stem, { id, title: look.title });
    next = changed;
    return name;
  };
  const inputs = Object.fromEntries(Object.entries(look.inputs).map(([input, id]) => [input, named(input, id)]));
  const adopted = { ...look, inputs, ...(picture && { picture: named("look", picture) }) };
  return [next, adopted];
}

/**
 * A layer with a portable look. What is drawn on frames stays; regions with names that the look knows have its style from
 * the frame `first` on.
 */
export function useLook(
  document: ProjectDocument,
  place: LayerPlace,
  portableLook: Look,
  { paintings, design }: LookParts,
  first: number,
): ProjectDocument {
  const { picture: _picture, ...rest } = portableLook;
  const [next, look] = adopted(document, rest);
  return changeLayer(next, place, (layer) => {
    const kept = Object.entries(layer.inputs ?? {}).filter(([input]) => !paintings.includes(input));
    const { seed: _seed, ...others } = layer;
    const changed: Layer = {
      ...others,
      method: look.method,
      params: look.params,
      inputs: { ...Object.fromEntries(kept), ...look.inputs },
      ...(look.seed && { seed: look.seed }),
    };
    return design && (look.styles || look.regions)
      ? withPart(changed, design, styled((layer.parts?.[design] as Design | undefined) ?? {}, look, first))
      : changed;
  });
}

/** The design with the look's styles; regions that it does not have are left out, but for the one of everything else. */
function styled(design: Design, { styles, regions = {} }: Look, first: number): Design {
  const drawn = Object.keys(design.regions ?? {});
  const tracked = (design.keys ?? []).map(({ region }) => region);
  const known = Object.entries(regions).filter(
    ([name]) => drawn.includes(name) || tracked.includes(name) || name === REST,
  );
  let keys = (design.keys ?? []).filter(({ region }) => !known.some(([name]) => name === region));
  for (const [region, look] of known) keys = putOnTrack(keys, { region, frame: first, ...look });
  return { ...design, ...(styles && { styles: { ...design.styles, ...styles } }), keys };
}

// -- files

interface LookFile {
  impasto: "look";
  version: 1;
  look: Look;
  /** Bytes of the assets that it names, as data URLs, by id. */
  files: Record<string, { name: string; data: string }>;
}

/** Ids of the assets of a portable look. */
export const assetsOf = ({ inputs, picture }: Look): string[] => [
  ...new Set([...Object.values(inputs), ...(picture ? [picture] : [])]),
];

export const fileOf = (look: Look, files: LookFile["files"]): LookFile => ({
  impasto: "look",
  version: 1,
  look,
  files,
});

/** The look of a file. Throws an Error if the text is none. */
export function readLook(text: string): LookFile {
  const found = JSON.parse(text) as Partial<LookFile> | null;
  const { look, files } = found ?? {};
  const whole = found?.impasto === "look" && look && files && typeof look.method === "string";
  if (!whole || typeof look.title !== "string" || typeof look.params !== "object" || typeof look.inputs !== "object")
    throw new Error("The file has no look of Impasto.");
  return fileOf(look, files);
}

/** The look with other asset ids. */
export function renumbered(look: Look, ids: ReadonlyMap<string, string>): Look {
  const { picture, ...rest } = look;
  const inputs = Object.entries(look.inputs).flatMap(([input, id]) => {
    const found = ids.get(id);
    return found ? [[input, found]] : [];
  });
  const shown = picture && ids.get(picture);
  return { ...rest, inputs: Object.fromEntries(inputs), ...(shown && { picture: shown }) };
}

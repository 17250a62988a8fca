/** Designs: regions of a video, and their styles and directions over time; pure functions that return a changed copy. */

import type { Params } from "../../api/schemas";
import type { Framed, Point } from "./document";

export type Ease = "linear" | "smooth" | "in" | "out" | "hold";

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

/** A style of the user's own: another one with changes; without `base`, that of the layer's parameters. */
export interface OwnStyle {
  base?: string | null;
  technique?: Params;
  [parameter: string]: unknown;
}

/**
 * Patterns of strokes: regular = parallel strokes at an angle. The angle of a center, spiral or node turns each stroke
 * relative to the ray from the centre.
 */
export type Pattern = "regular" | "center" | "spiral" | "node" | "saddle" | "wedge" | "trisector";

export interface DirectionElement {
  pattern: Pattern;
  at: Point;
  /** Degrees. */
  angle?: number;
  /** Distance at which 37 % of the influence is left, in heights of the picture; 0 = everywhere, too. */
  reach?: number | "everywhere";
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

/** A stroke of a brush: what it covers belongs to `region`. Later ones of a frame cover earlier ones. */
export interface Correction {
  region: string;
  frame: number;
  points: Point[];
  /** Heights of the picture. */
  width: number;
}

/** Name of the region of everything that no other one has. */
export const REST = "rest";

/** The document that the editor of regions edits. */
export interface Design {
  regions?: Record<string, Region>;
  styles?: Record<string, OwnStyle>;
  keys?: StyleKey[];
  directions?: DirectionKey[];
  corrections?: Correction[];
}

interface RegionFramed extends Framed {
  region: string;
}

/** The list with `item` in place of the one at its frame on the track of its region, in the order of frames. */
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

/** Remove a region with its keys and directions. */
export function removeRegion(design: Design, name: string): Design {
  const { [name]: _removed, ...regions } = design.regions ?? {};
  const others = <Item extends RegionFramed>(items: readonly Item[] = []) =>
    items.filter((item) => item.region !== name);
  return {
    ...design,
    regions,
    keys: others(design.keys),
    directions: others(design.directions),
    ...(design.corrections && { corrections: others(design.corrections) }),
  };
}

/** Give a region another name, wherever the design names it. */
export function renameRegion(design: Design, from: string, to: string): Design {
  const regions = Object.fromEntries(
    Object.entries(design.regions ?? {}).map(([name, region]) => [name === from ? to : name, region]),
  );
  const renamed = <Item extends RegionFramed>(items: readonly Item[] = []) =>
    items.map((item) => (item.region === from ? { ...item, region: to } : item));
  return {
    ...design,
    regions,
    keys: renamed(design.keys),
    directions: renamed(design.directions),
    ...(design.corrections && { corrections: renamed(design.corrections) }),
  };
}

/** Whether two regions can be joined: a region has one label of the label maps at most. */
export const canMerge = (a: Region | undefined, b: Region | undefined): boolean =>
  typeof a?.label !== "number" || typeof b?.label !== "number";

/** Join several regions, of any kinds, into the first: it gets all that they are made of, and their corrections. */
export function mergeRegions(design: Design, names: readonly string[]): Design {
  const [first, ...rest] = names.filter((name) => design.regions?.[name]);
  if (!first || !rest.length) return design;
  const all = [first, ...rest].map((name) => design.regions?.[name] ?? {});
  const merged: Region = { ...all[0] };
  const objects = [...new Set(all.flatMap((region) => region.objects ?? []))].sort((a, b) => a - b);
  const tubes = [...new Set(all.flatMap((region) => region.tubes ?? []))].sort((a, b) => a - b);
  const polygons = all.flatMap((region) => region.polygons ?? []);
  if (objects.length) merged.objects = objects;
  if (tubes.length) merged.tubes = tubes;
  if (polygons.length) merged.polygons = polygons;
  const label = all.find((region) => typeof region.label === "number")?.label;
  if (typeof label === "number") merged.label = label;
  const corrections = design.corrections?.map((one) => (rest.includes(one.region) ? { ...one, region: first } : one));
  const whole = withRegion(rest.reduce(removeRegion, design), first, merged);
  return corrections ? { ...whole, corrections } : whole;
}

export const withRegion = (design: Design, name: string, region: Region): Design => ({
  ...design,
  regions: { ...design.regions, [name]: region },
});

/** The tubes of a region, those of its objects included; `partsOf` gives the tubes of an object. */
export const tubesOf = (
  { objects = [], tubes = [] }: Region,
  partsOf: (object: number) => readonly number[],
): number[] => [...new Set([...tubes, ...objects.flatMap(partsOf)])].sort((a, b) => a - b);

/** Take a tube out of a region and add it to the region `name`, which `splitRegion` has made of another part of it. */
export function moveTube(design: Design, owner: string, tube: number, name: string): Design {
  const { [owner]: whole, [name]: part } = design.regions ?? {};
  const left = whole?.tubes?.filter((other) => other !== tube) ?? [];
  if (!left.length || left.length === whole?.tubes?.length) return design;
  const tubes = [...(part?.tubes ?? []), tube].sort((a, b) => a - b);
  return withRegion(withRegion(design, owner, { ...whole, tubes: left }), name, { ...part, tubes });
}

/** Remove a tube from a region: it becomes the region `name`, with the keys of the former region. */
export function splitRegion(
  design: Design,
  owner: string,
  tube: number,
  name: string,
  partsOf: (object: number) => readonly number[],
): Design {
  const whole = design.regions?.[owner] ?? {};
  const left = tubesOf(whole, partsOf).filter((other) => other !== tube);
  if (!left.length) return design;
  const { objects: _objects, ...rest } = whole;
  const copied = <Item extends RegionFramed>(items: readonly Item[] = []): Item[] => [
    ...items,
    ...trackOf(items, owner).map((item) => ({ ...item, region: name })),
  ];
  return {
    ...withRegion(withRegion(design, owner, { ...rest, tubes: left }), name, { tubes: [tube] }),
    keys: copied(design.keys),
    directions: copied(design.directions),
  };
}

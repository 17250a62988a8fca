/**
 * Changes of the layers of a key: pure functions that return a changed copy. Layers are from back to front; a group
 * follows its layers, which name it as their parent.
 */

import { freeName } from "../document/document";
import type { KeyPicture, PictureLayer } from "../drawing/strokes";

/** Id of a key's mask, which is no layer of its picture. */
export const MASK = "mask";
export const MOST_LAYERS = 200;
const NAME_LENGTH = 200;

export const emptyLayer = (id: string, name: string, base: string | null): PictureLayer => ({
  id,
  name: name.slice(0, NAME_LENGTH),
  opacity: 1,
  visible: true,
  base,
  strokes: [],
});

interface Node {
  layer: PictureLayer;
  children: Node[];
}

/** The layers of a group (null: those in none) with theirs. A layer whose group is missing is in none. */
function nodesOf(layers: readonly PictureLayer[], parent: string | null = null): Node[] {
  const groups = new Set(layers.filter(({ group }) => group).map(({ id }) => id));
  const parentOf = (layer: PictureLayer) => (layer.parent && groups.has(layer.parent) ? layer.parent : null);
  return layers
    .filter((layer) => parentOf(layer) === parent && layer.id !== parent)
    .map((layer) => ({ layer, children: layer.group ? nodesOf(layers, layer.id) : [] }));
}

const flat = (nodes: readonly Node[], parent: string | null = null): PictureLayer[] =>
  nodes.flatMap(({ layer, children }) => [
    ...flat(children, layer.id),
    (layer.parent ?? null) === parent ? layer : { ...layer, parent },
  ]);

/** The siblings among which a layer is, and its place there. */
function placeOf(nodes: Node[], id: string): [Node[], number] | null {
  const at = nodes.findIndex(({ layer }) => layer.id === id);
  if (at >= 0) return [nodes, at];
  for (const { children } of nodes) {
    const found = placeOf(children, id);
    if (found) return found;
  }
  return null;
}

/** The picture after a change of its tree; the same picture if the change returns false. */
function changed(picture: KeyPicture, change: (nodes: Node[]) => boolean): KeyPicture {
  const nodes = nodesOf(picture.layers);
  return change(nodes) ? { ...picture, layers: flat(nodes) } : picture;
}

export const freeId = ({ layers }: KeyPicture, stem: string): string =>
  freeName(stem, (id) => id === MASK || layers.some((layer) => layer.id === id));

/** Depth of a layer in groups, from 0. */
export function depthOf(layers: readonly PictureLayer[], layer: PictureLayer): number {
  const parent = layers.find(({ id }) => id === layer.parent);
  return parent ? 1 + depthOf(layers, parent) : 0;
}

/** Put a layer directly above another one; at the top if that is not there. */
export function addLayer(picture: KeyPicture, layer: PictureLayer, above: string): KeyPicture {
  if (picture.layers.length >= MOST_LAYERS) return picture;
  return changed(picture, (nodes) => {
    const [siblings, at] = placeOf(nodes, above) ?? [nodes, nodes.length - 1];
    siblings.splice(at + 1, 0, { layer, children: [] });
    return true;
  });
}

/** Remove a layer, or a group with its layers. A key keeps one layer to paint on. */
export function removeLayer(picture: KeyPicture, id: string): KeyPicture {
  const next = changed(picture, (nodes) => {
    const place = placeOf(nodes, id);
    place?.[0].splice(place[1], 1);
    return place !== null;
  });
  return next.layers.some(({ group }) => !group) ? next : picture;
}

/** Swap a layer with its neighbour among the layers of its group; at the end of a group, it leaves that. */
export function moveLayerBy(picture: KeyPicture, id: string, by: 1 | -1): KeyPicture {
  return changed(picture, (nodes) => {
    const [siblings, at] = placeOf(nodes, id) ?? [nodes, -1];
    const [node] = siblings.slice(at, at + 1);
    if (at < 0 || !node) return false;
    const to = at + by;
    if (to >= 0 && to < siblings.length) {
      siblings.splice(at, 1);
      siblings.splice(to, 0, node);
      return true;
    }
    const outer = node.layer.parent ? placeOf(nodes, node.layer.parent) : null;
    if (!outer) return false;
    siblings.splice(at, 1);
    outer[0].splice(outer[1] + (by > 0 ? 1 : 0), 0, node);
    return true;
  });
}

/** Put a layer above or below another one, or on top of the layers of a group. */
export function moveLayer(
  picture: KeyPicture,
  id: string,
  target: string,
  where: "above" | "below" | "inside",
): KeyPicture {
  if (id === target) return picture;
  return changed(picture, (nodes) => {
    const from = placeOf(nodes, id);
    const node = from?.[0][from[1]];
    if (!from || !node || placeOf(node.children, target)) return false;
    from[0].splice(from[1], 1);
    const to = placeOf(nodes, target);
    const goal = to?.[0][to[1]];
    if (!to || !goal) return false;
    if (where === "inside") {
      if (!goal.layer.group) return false;
      goal.children.push(node);
    } else to[0].splice(to[1] + (where === "above" ? 1 : 0), 0, node);
    return true;
  });
}

/** Put a layer into a new group. */
export function groupLayer(picture: KeyPicture, id: string): KeyPicture {
  if (picture.layers.length >= MOST_LAYERS) return picture;
  const group: PictureLayer = {
    ...emptyLayer(freeId(picture, "group"), "Group", null),
    group: true,
    blend: "pass-through",
  };
  return changed(picture, (nodes) => {
    const [siblings, at] = placeOf(nodes, id) ?? [nodes, -1];
    const [node] = siblings.slice(at, at + 1);
    if (at < 0 || !node) return false;
    siblings.splice(at, 1, { layer: group, children: [node] });
    return true;
  });
}

/** Take the layers out of a group, which is removed. */
export function ungroup(picture: KeyPicture, id: string): KeyPicture {
  return changed(picture, (nodes) => {
    const place = placeOf(nodes, id);
    const node = place?.[0][place[1]];
    if (!place || !node?.layer.group) return false;
    place[0].splice(place[1], 1, ...node.children);
    return true;
  });
}

/** Put a copy of a layer above it. */
export function duplicateLayer(picture: KeyPicture, id: string): KeyPicture {
  const layer = picture.layers.find((one) => one.id === id);
  if (!layer || layer.group) return picture;
  const name = freeName(`${layer.name.slice(0, NAME_LENGTH - 20)} copy`, (one) =>
    picture.layers.some((other) => other.name === one),
  );
  return addLayer(picture, { ...layer, id: freeId(picture, "paint"), name }, id);
}

/** The layer onto which another one is merged: the next one below it in its group. A group is merged with its layers. */
export function mergedOnto(picture: KeyPicture, id: string): PictureLayer | undefined {
  const nodes = nodesOf(picture.layers);
  const [siblings, at] = placeOf(nodes, id) ?? [nodes, -1];
  const own = siblings[at]?.layer;
  const below = own?.group ? own : siblings[at - 1]?.layer;
  return below && (own?.group || !below.group) ? below : undefined;
}

/** A picture of the two layers that become one, or of the layers of a group, alone. */
export function mergePicture(picture: KeyPicture, id: string): KeyPicture | null {
  const upper = picture.layers.find((layer) => layer.id === id);
  const lower = mergedOnto(picture, id);
  if (!upper || !lower) return null;
  const lowest: PictureLayer = { ...lower, blend: "over", clip: false, parent: null, visible: true };
  if (lower === upper) {
    const inside = flat(nodesOf(picture.layers, id), id);
    return { layers: [...inside, lowest] };
  }
  return { layers: [lowest, { ...upper, parent: null, clip: Boolean(upper.clip && !lower.clip) }] };
}

/** The picture with the result of a merge, a picture of the asset `base`, in place of the layers. */
export function withMerged(picture: KeyPicture, id: string, base: string): KeyPicture {
  const lower = mergedOnto(picture, id);
  if (!lower) return picture;
  const { mask: _mask, group: _group, ...kept } = lower;
  const blend = lower.blend === "pass-through" ? "over" : (lower.blend ?? "over");
  const made: PictureLayer = { ...kept, id: freeId(picture, "merged"), base, strokes: [], opacity: 1, blend };
  return changed(picture, (nodes) => {
    const place = placeOf(nodes, lower.id);
    if (!place) return false;
    place[0].splice(place[1], lower.id === id ? 1 : 2, { layer: made, children: [] });
    return true;
  });
}

/** Whether nothing has been taken from a mask with paint everywhere. */
export const isFullMask = ({ base, strokes: [first, ...more] }: PictureLayer): boolean =>
  base === null &&
  !more.length &&
  first?.kind === "fill" &&
  !first.erase &&
  first.runs[0] === 0 &&
  first.runs.length === 2;

/** A mask with paint everywhere. */
export const fullMask = ({ width, height }: { width: number; height: number }): PictureLayer => ({
  ...emptyLayer(MASK, "Mask", null),
  strokes: [{ kind: "fill", color: "#ffffff", opacity: 1, runs: [0, width * height] }],
});

/** The film of a project: its shots in order; pure functions that return a changed copy of the document. */

import { addAsset, changeShot, freeName, type Layer, type ProjectDocument, type Shot, shotOf } from "./document";

/** Frames [first, end) of a clip. */
export type Frames = readonly [first: number, end: number];

/** An uploaded clip. */
export interface Clip {
  id: string;
  title: string;
}

export const MOST_SHOTS = 500;
const NAME_LENGTH = 200;

/** The frames of a shot whose clip has `frames` of them: at least one, also if the clip is shorter than the range says. */
export function framesOf({ range }: Shot, frames: number): Frames {
  const [first, end] = range ?? [0, frames];
  const from = Math.min(first, Math.max(0, frames - 1));
  return [from, Math.max(from + 1, Math.min(end, frames))];
}

/** The name of a shot on the page, and its number, from 1. */
export function titleOf(document: ProjectDocument, id: string): string {
  const at = document.shots.findIndex((shot) => shot.id === id);
  return document.shots[at]?.name || `Shot ${at + 1}`;
}

const idOf = (stem: string, taken: readonly string[]): string => {
  for (let i = taken.length + 1; ; i++) if (!taken.includes(`${stem}${i}`)) return `${stem}${i}`;
};

const shotIds = ({ shots }: ProjectDocument): string[] => shots.map((shot) => shot.id);
const layerIds = ({ shots }: ProjectDocument): string[] => shots.flatMap(({ layers }) => layers.map(({ id }) => id));

/** The same layers under ids that no layer of the film has, so that each shot is edited alone. */
function copied(document: ProjectDocument, layers: readonly Layer[]): Layer[] {
  const taken = layerIds(document);
  return layers.map((layer) => {
    const id = idOf("l", taken);
    taken.push(id);
    return { ...layer, id };
  });
}

/** The document with shots put after the one at `index`; null: at the end. */
const inserted = (document: ProjectDocument, index: number, shots: readonly Shot[]): ProjectDocument => ({
  ...document,
  shots: document.shots.toSpliced(index + 1, 0, ...shots),
});

/** The film with a shot for each clip after the shot `after`, each with one layer of this method. */
export function addClips(
  document: ProjectDocument,
  clips: readonly Clip[],
  method: string,
  after = document.shots.at(-1)?.id ?? "",
): ProjectDocument {
  let [next, last] = [document, after];
  for (const { id, title } of clips.slice(0, MOST_SHOTS - document.shots.length)) {
    const [named, video] = addAsset(next, "clip", { id, title: title.slice(0, NAME_LENGTH) });
    const shot: Shot = {
      id: idOf("s", shotIds(named)),
      name: title.replace(/\.[^.]+$/, "").slice(0, NAME_LENGTH),
      video,
      layers: copied(named, [{ id: "l", method }]),
    };
    const at = named.shots.findIndex((one) => one.id === last);
    next = inserted(named, at < 0 ? named.shots.length - 1 : at, [shot]);
    last = shot.id;
  }
  return next;
}

/**
 * The film with a shot cut at frames of its clip, which has `length` frames. Every piece has the shot's layers with all that
 * is drawn on them: a drawing can determine frames of another piece. The first piece keeps the shot's id.
 */
export function cutShot(document: ProjectDocument, id: string, at: readonly number[], length: number): ProjectDocument {
  const shot = shotOf(document, id);
  if (!shot) return document;
  const [first, end] = framesOf(shot, length);
  const cuts = [...new Set(at)].filter((frame) => first < frame && frame < end).sort((a, b) => a - b);
  const room = MOST_SHOTS - document.shots.length;
  const starts = [first, ...cuts.slice(0, room)];
  if (starts.length < 2) return document;
  const named = (number: number) => (shot.name ? { name: pieceName(shot.name, number) } : {});
  const ranges = starts.map((start, i): [number, number] => [start, starts[i + 1] ?? end]);
  let next = changeShot(document, id, (one) => ({ ...one, range: ranges[0] ?? null, ...named(1) }));
  const index = document.shots.indexOf(shot);
  ranges.slice(1).forEach((range, i) => {
    const piece = { ...shot, id: idOf("s", shotIds(next)), range, ...named(i + 2) };
    next = inserted(next, index + i, [{ ...piece, layers: copied(next, shot.layers) }]);
  });
  return next;
}

const pieceName = (name: string, number: number): string => `${name.slice(0, NAME_LENGTH - 6)}, ${number}`;

/** The film with a copy of a shot after it. */
export function duplicateShot(document: ProjectDocument, id: string): ProjectDocument {
  const shot = shotOf(document, id);
  if (!shot || document.shots.length >= MOST_SHOTS) return document;
  const taken = (candidate: string) => document.shots.some((one) => one.name === candidate);
  const name = shot.name && freeName(`${shot.name.slice(0, NAME_LENGTH - 20)}, copy`, taken);
  const own = { id: idOf("s", shotIds(document)), layers: copied(document, shot.layers), ...(name && { name }) };
  const copy = { ...shot, ...own };
  return inserted(document, document.shots.indexOf(shot), [copy]);
}

/** The film without a shot, and without the variants of its layers. The last shot stays. */
export function removeShot(document: ProjectDocument, id: string): ProjectDocument {
  if (document.shots.length < 2 || !shotOf(document, id)) return document;
  const next = { ...document, shots: document.shots.filter((shot) => shot.id !== id) };
  const variants = document.variants?.filter((variant) => variant.shot !== id);
  return variants ? { ...next, variants } : next;
}

/** The film with a shot at another place, from 0. */
export function moveShot(document: ProjectDocument, id: string, to: number): ProjectDocument {
  const shot = shotOf(document, id);
  if (!shot) return document;
  const others = document.shots.filter((one) => one !== shot);
  const at = Math.min(Math.max(0, to), others.length);
  if (document.shots.indexOf(shot) === at) return document;
  return { ...document, shots: others.toSpliced(at, 0, shot) };
}

/** The film with other in and out points of a shot whose clip has `length` frames: null for the whole clip. */
export function trimShot(
  document: ProjectDocument,
  id: string,
  frames: Frames | null,
  length: number,
): ProjectDocument {
  return changeShot(document, id, ({ range: _range, ...shot }) => {
    if (!frames) return shot;
    const [first, end] = framesOf({ ...shot, range: [frames[0], frames[1]] }, length);
    return first === 0 && end === length ? shot : { ...shot, range: [first, end] };
  });
}

export const renameShot = (document: ProjectDocument, id: string, name: string): ProjectDocument =>
  changeShot(document, id, (shot) => ({ ...shot, name: name.slice(0, NAME_LENGTH) }));

/** The first shot that differs between two documents; empty: none of the second does. */
export function changedShot(before: ProjectDocument, after: ProjectDocument): string {
  return after.shots.find((shot) => shotOf(before, shot.id) !== shot)?.id ?? "";
}

/** Changes that the service does not have yet, kept in this browser beyond a crash of the page. */

import type { ProjectDocument } from "../document/document";
import { strokesOfText, textOfStrokes } from "../drawing/stroke-text";
import type { KeyPicture, Stroke } from "../drawing/strokes";
import { shotOfPicture } from "./session";

export interface Unsaved {
  /** The stored version that the changes follow. */
  version: number;
  document: ProjectDocument;
  /** The document of a save whose answer has not arrived; the next version may already contain it. */
  sent?: ProjectDocument | undefined;
  /** Painted keys that are not uploaded: by `pictureKey`. */
  pictures: Record<string, KeyPicture>;
}

const nameOf = (project: string): string => `impasto.project:${project}`;

export function readUnsaved(project: string): Unsaved | null {
  const text = localStorage.getItem(nameOf(project));
  if (!text) return null;
  const found: Partial<Unsaved> & Pick<Unsaved, "version" | "document"> = JSON.parse(text);
  const first = found.document.shots[0]?.id ?? "";
  const pictures = Object.entries(found.pictures ?? {});
  return {
    ...found,
    pictures: Object.fromEntries(
      pictures.map(([key, picture]) => [shotOfPicture(key) ? key : `${first}/${key}`, unpacked(picture)]),
    ),
  };
}

/** The version that unsaved changes follow, given the stored document. A lost answer to a save is no conflict. */
export function versionFollowed(unsaved: Unsaved, stored: { version: number; document: ProjectDocument }): number {
  const arrived = JSON.stringify(unsaved.sent) === JSON.stringify(stored.document);
  return arrived ? stored.version : unsaved.version;
}

/** Throws a DOMException if the browser has no room for it. */
export const writeUnsaved = (project: string, unsaved: Unsaved): void =>
  localStorage.setItem(nameOf(project), JSON.stringify({ ...unsaved, pictures: packed(unsaved.pictures) }));

/** Strokes as text, which has their tips once only. */
const packed = (pictures: Unsaved["pictures"]) =>
  Object.fromEntries(
    Object.entries(pictures).map(([key, { layers }]) => [
      key,
      { layers: layers.map((layer) => ({ ...layer, strokes: textOfStrokes(layer.strokes) })) },
    ]),
  );

/** Earlier versions of the page have kept lists of strokes. */
const unpacked = ({ layers }: KeyPicture): KeyPicture => ({
  layers: layers.map((layer) => {
    const strokes: unknown = layer.strokes;
    return { ...layer, strokes: typeof strokes === "string" ? strokesOfText(strokes) : (strokes as Stroke[]) };
  }),
});

export const dropUnsaved = (project: string): void => localStorage.removeItem(nameOf(project));

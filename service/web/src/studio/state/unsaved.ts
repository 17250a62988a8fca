/** Changes that the service does not have yet, kept in this browser beyond a crash of the page. */

import type { ProjectDocument } from "../document/document";
import type { KeyPicture } from "../drawing/strokes";

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
  return { pictures: {}, ...found };
}

/** The version that unsaved changes follow, given the stored document. A lost answer to a save is no conflict. */
export function versionFollowed(unsaved: Unsaved, stored: { version: number; document: ProjectDocument }): number {
  const arrived = JSON.stringify(unsaved.sent) === JSON.stringify(stored.document);
  return arrived ? stored.version : unsaved.version;
}

/** Throws a DOMException if the browser has no room for it. */
export const writeUnsaved = (project: string, unsaved: Unsaved): void =>
  localStorage.setItem(nameOf(project), JSON.stringify(unsaved));

export const dropUnsaved = (project: string): void => localStorage.removeItem(nameOf(project));

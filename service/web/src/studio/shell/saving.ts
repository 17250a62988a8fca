/** Saving an open project, and what this browser keeps of it until that is done. */

import { effect } from "@preact/signals";
import * as shared from "../../api/api";
import { type Project, readProject, saveProject } from "../document/api";
import { createSaver, type Saver } from "../document/autosave";
import { type ProjectDocument, pruneAssets } from "../document/document";
import { record } from "../document/undo";
import type { KeyPicture } from "../drawing/strokes";
import type { Session } from "../state/session";
import { dropUnsaved, readUnsaved, type Unsaved, versionFollowed, writeUnsaved } from "../state/unsaved";

export class Saving {
  readonly saver: Saver;
  /** Pictures that are not uploaded, the one under the pen included; the shown shot gives them. */
  pictures: () => Record<string, KeyPicture> = () => this.session.pending();
  private readonly restored: Unsaved | null;
  /** The document, while it is not saved. */
  private unsaved: ProjectDocument | null = null;
  private sent: ProjectDocument | undefined;
  private readonly dispose: () => void;

  constructor(
    private readonly session: Session,
    project: Project,
  ) {
    this.restored = readUnsaved(project.id);
    if (this.restored) this.restore(this.restored);
    this.saver = this.start(project);
    this.dispose = effect(() => this.saver.changed(session.document.value));
  }

  private restore({ document, pictures }: Unsaved): void {
    const { history } = this.session;
    const state = { document, pictures: { ...history.peek().present.pictures, ...pictures } };
    history.value = record(history.peek(), "Restore unsaved changes", state);
  }

  /** Unsaved changes that follow another version than the stored one are a conflict, which the page shows. */
  private start(project: Project): Saver {
    return createSaver({
      version: this.restored ? versionFollowed(this.restored, project) : project.version,
      document: project.document,
      save: (document, version) => this.save(pruneAssets(document), version),
      asProblem: shared.asProblem,
      onstate: (state) => {
        this.session.saving.value = state;
      },
      keep: (document) => {
        this.unsaved = document;
        this.keep();
      },
    });
  }

  /** Save; a version with the very same document, of which the answer was lost, is as good. */
  private async save(document: ProjectDocument, version: number): Promise<number> {
    const { projectId } = this.session;
    this.sent = document;
    this.keep();
    try {
      return await saveProject(projectId, document, version);
    } catch (error) {
      if (!(error instanceof shared.Problem) || error.status !== 412) throw error;
      const stored = await readProject(projectId);
      if (JSON.stringify(stored.document) !== JSON.stringify(document)) throw error;
      return stored.version;
    }
  }

  /** Keep what is not saved in this browser. */
  keep(): void {
    const { projectId, document } = this.session;
    const pictures = this.pictures();
    if (!this.unsaved && !Object.keys(pictures).length) {
      dropUnsaved(projectId);
      return;
    }
    const present = this.unsaved ?? document.peek();
    const unsaved = { version: this.saver?.version ?? 0, document: present, sent: this.sent, pictures };
    try {
      writeUnsaved(projectId, unsaved);
    } catch (error) {
      console.info("Impasto: this browser has no room for unsaved changes.", error);
    }
  }

  close(): void {
    this.dispose();
    this.saver.close();
  }
}

/**
 * The stored project. Changes that this browser kept for a page of an earlier schema are saved first: the service writes
 * them in the present one. If another version is stored, they are a conflict, which the page shows.
 */
export async function openProject(id: string): Promise<Project> {
  const project = await readProject(id);
  const unsaved = readUnsaved(id);
  if (!unsaved || unsaved.document.schema === project.document.schema) return project;
  try {
    const version = await saveProject(id, unsaved.document, unsaved.version);
    const saved = await readProject(id);
    writeUnsaved(id, { version, document: saved.document, pictures: unsaved.pictures });
    return saved;
  } catch (error) {
    if (!(error instanceof shared.Problem) || error.status !== 412) throw error;
    return project;
  }
}

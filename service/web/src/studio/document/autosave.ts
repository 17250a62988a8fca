/** Saving the document within a second of a change, never over another tab's version. */

import type { Problem } from "../../api/api";
import type { ProjectDocument } from "./document";

export type SaveState =
  | { name: "saved" }
  | { name: "waiting" | "saving" }
  /** The service cannot be reached: saving is tried again; the changes are kept in this browser. */
  | { name: "offline"; problem: Problem }
  /** Another tab or program has saved another version. */
  | { name: "conflict" }
  /** The service refused the document. */
  | { name: "refused"; problem: Problem };

export interface SaverOptions {
  version: number;
  document: ProjectDocument;
  /** Resolves to the new version. */
  save(document: ProjectDocument, version: number): Promise<number>;
  asProblem(error: unknown): Problem;
  onstate(state: SaveState): void;
  /** Keep unsaved changes beyond a crash of the page; null: there are none. */
  keep(document: ProjectDocument | null): void;
  delayMs?: number;
}

export interface Saver {
  readonly version: number;
  /** The document has changed. */
  changed(document: ProjectDocument): void;
  /** Save now; resolves when the present document is saved or saving failed. */
  flush(): Promise<boolean>;
  /** Save over another tab's version. */
  overwrite(theirVersion: number): Promise<boolean>;
  close(): void;
}

/** Whether the same request may succeed later: the service is away or overloaded. */
export const isPassing = ({ code, status }: Problem): boolean => code === "offline" || status >= 500 || status === 429;

const DELAY_MS = 400;
const RETRY_MS = 3000;

export function createSaver({
  version,
  document,
  save,
  asProblem,
  onstate,
  keep,
  delayMs = DELAY_MS,
}: SaverOptions): Saver {
  let saved = document;
  let wanted = document;
  let running: Promise<boolean> | null = null;
  let timer: ReturnType<typeof setTimeout> | undefined;
  let stopped = false;
  let conflict = false;

  function changed(next: ProjectDocument): void {
    wanted = next;
    if (conflict) {
      keep(wanted);
      return;
    }
    if (wanted === saved && !running) {
      clearTimeout(timer);
      settle();
      return;
    }
    keep(wanted);
    onstate({ name: "waiting" });
    schedule(delayMs);
  }

  function schedule(ms: number): void {
    clearTimeout(timer);
    if (!stopped) timer = setTimeout(flush, ms);
  }

  function settle(): void {
    keep(null);
    onstate({ name: "saved" });
  }

  async function flush(): Promise<boolean> {
    clearTimeout(timer);
    while (running) await running; // somebody else who waited may have begun the next one
    if (conflict) return false;
    if (wanted === saved) return true;
    running = saveOnce().finally(() => {
      running = null;
    });
    const done = await running;
    return done && wanted !== saved ? flush() : done;
  }

  async function saveOnce(): Promise<boolean> {
    const sent = wanted;
    onstate({ name: "saving" });
    try {
      version = await save(sent, version);
      saved = sent;
      if (wanted === sent) settle();
      return true;
    } catch (error) {
      failed(asProblem(error));
      return false;
    }
  }

  function failed(problem: Problem): void {
    if (problem.status === 412) {
      conflict = true;
      onstate({ name: "conflict" });
    } else if (isPassing(problem)) {
      onstate({ name: "offline", problem });
      schedule(RETRY_MS);
    } else {
      onstate({ name: "refused", problem });
    }
  }

  return {
    get version() {
      return version;
    },
    changed,
    flush,
    overwrite(theirVersion) {
      conflict = false;
      version = theirVersion;
      return flush();
    },
    close() {
      stopped = true;
      clearTimeout(timer);
    },
  };
}

/** Whether everything is saved, and what to do where it is not. */

import { readProject } from "../document/api";
import type { Saver } from "../document/autosave";
import type { Store } from "../state/store";

const WORDS = { saved: "Saved", waiting: "Saving…", saving: "Saving…" };

export interface SaveStatusProps {
  store: Store;
  saver: Saver;
  /** Open the stored version, and give up the changes of this tab. */
  reload(): void;
}

export function SaveStatus({ store, saver, reload }: SaveStatusProps) {
  const state = store.saving.value;
  if (state.name === "conflict") {
    const overwrite = async () => saver.overwrite((await readProject(store.projectId)).version);
    return (
      <div class="save-status wrong" role="alert">
        <p>Another tab or program has saved a newer version of this project. Nothing of yours is lost yet.</p>
        <button type="button" class="button small" onClick={overwrite}>
          Keep mine
        </button>
        <button type="button" class="button small" onClick={reload}>
          Load the other
        </button>
      </div>
    );
  }
  if (state.name === "offline" || store.uploadsWait.value) {
    return (
      <p class="save-status wrong" role="alert">
        Not saved: the service does not answer. Your changes are kept in this browser, and saved when it is back.
      </p>
    );
  }
  if (state.name === "refused") {
    return (
      <p class="save-status wrong" role="alert">
        Not saved: {state.problem.message} {state.problem.remedy}
      </p>
    );
  }
  const pending = store.uploading.value + store.storing.value + store.filling.value > 0;
  return (
    <p class="save-status" role="status">
      {pending ? "Saving…" : WORDS[state.name]}
    </p>
  );
}

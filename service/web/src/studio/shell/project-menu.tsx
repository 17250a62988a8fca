/** The project as a whole: a link to show it to others, a file to take it elsewhere, and its earlier versions. */

import { useRef, useState } from "preact/hooks";
import { download, saveFile } from "../../api/api";
import { ago } from "../../ui/format";
import { IconButton } from "../../ui/icons";
import { notify } from "../../ui/notices";
import {
  endShares,
  exportProject,
  listVersions,
  nameVersion,
  type ProjectVersion,
  restoreVersion,
  shareProject,
} from "../document/api";
import type { Saver } from "../document/autosave";
import { filmPath } from "../films/film";
import type { Store } from "../state/store";

const SHARE_DAYS = 30;
const SHOWN = 20;

export interface ProjectMenuProps {
  store: Store;
  saver: Saver;
  /** Save everything; false if that failed. */
  saveAll(): Promise<boolean>;
  /** Open the stored version. */
  reload(): void;
}

export function ProjectMenu(props: ProjectMenuProps) {
  const dialog = useRef<HTMLDialogElement>(null);
  const [versions, setVersions] = useState<ProjectVersion[]>([]);
  const open = async () => {
    dialog.current?.showModal();
    await props.saveAll();
    setVersions((await listVersions(props.store.projectId)).slice(0, SHOWN));
  };
  return (
    <>
      <button type="button" class="button quiet small" onClick={() => open().catch(notify)}>
        Share, versions
      </button>
      <dialog ref={dialog} class="project-menu" aria-labelledby="project-menu-title">
        <h2 id="project-menu-title">{props.store.document.value.name}</h2>
        <Share {...props} />
        <Versions {...props} versions={versions} />
        <form method="dialog">
          <button type="submit" class="button primary">
            Close
          </button>
        </form>
      </dialog>
    </>
  );
}

function Share({ store, saveAll }: ProjectMenuProps) {
  const [link, setLink] = useState("");
  const [comments, setComments] = useState(false);
  const share = async () => {
    await saveAll();
    const made = await shareProject(store.projectId, SHARE_DAYS, comments);
    setLink(made);
    await navigator.clipboard?.writeText(made).catch(() => {}); // the field shows it anyway
  };
  const end = async () => {
    await endShares(store.projectId);
    setLink("");
  };
  const save = async () => {
    await saveAll();
    saveFile(await exportProject(store.projectId), `${store.document.value.name}.zip`);
  };
  return (
    <section>
      <h3>Show it to others</h3>
      <p class="hint">
        Whoever has the link sees the project and its films for {SHARE_DAYS} days, and can change nothing.
      </p>
      <label class="check-row">
        <input
          type="checkbox"
          checked={comments}
          onChange={({ currentTarget }) => setComments(currentTarget.checked)}
        />
        They may comment on frames, and read all comments
      </label>
      {link && <input type="text" readOnly value={link} aria-label="Link to this project" />}
      <div class="actions">
        <button type="button" class="button small" onClick={() => share().catch(notify)}>
          Copy a link
        </button>
        <button type="button" class="button small" onClick={() => end().catch(notify)}>
          End all links
        </button>
      </div>
      <h3>Export the project</h3>
      <p class="hint">
        One file with everything in it. The start page of another service opens it; <code>impasto render</code> paints
        it.
      </p>
      <div class="actions">
        <button type="button" class="button small" onClick={() => save().catch(notify)}>
          Save as a file
        </button>
      </div>
    </section>
  );
}

function Versions({ store, saver, saveAll, reload, versions }: ProjectMenuProps & { versions: ProjectVersion[] }) {
  const restore = async (version: number) => {
    if (!(await saveAll())) return;
    await restoreVersion(store.projectId, version, saver.version);
    reload();
  };
  return (
    <section>
      <h3>Earlier versions</h3>
      <p class="hint">A version with a name or a note is kept, as are those of which a film was painted.</p>
      <ul class="versions">
        {versions.map(({ version, at, label, jobs = [] }, i) => (
          <li key={version}>
            <input
              type="text"
              maxLength={200}
              defaultValue={label}
              placeholder={`Version ${version}`}
              aria-label={`Name or note of version ${version}`}
              onChange={({ currentTarget: { value } }) =>
                nameVersion(store.projectId, version, value.trim()).catch(notify)
              }
            />
            <small>{ago(at)}</small>
            {jobs.length > 0 && (
              <IconButton
                name="download"
                label={`Download the film of version ${version}`}
                onClick={() => download(filmPath(store.projectId, version)).catch(notify)}
              />
            )}
            {i === 0 ? (
              <small>present</small>
            ) : (
              <button
                type="button"
                class="button small"
                aria-label={`Restore version ${version}`}
                onClick={() => restore(version).catch(notify)}
              >
                Restore
              </button>
            )}
          </li>
        ))}
      </ul>
    </section>
  );
}

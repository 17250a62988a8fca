/** The film of several shots: how far each is, and the film in one file, watched here or saved. */

import { useRef, useState } from "preact/hooks";
import * as api from "../../api/api";
import { isFinal, stateWord } from "../../jobs/progress";
import { percent } from "../../ui/format";
import { notify } from "../../ui/notices";
import type { Session } from "../state/session";
import type { Film, ShotFilm } from "./film";

export function WholeFilm({ film, session }: { film: Film; session: Session }) {
  const shots = film.shots.value;
  const [joining, setJoining] = useState<number | null>(null);
  if (shots.length < 2) return null;
  const shown = film.notes.value.length || film.ready.value || film.painting.value || shots.some(({ job }) => job);
  if (!shown) return null;
  const wait = () => film.joined(setJoining).finally(() => setJoining(null));
  const save = async () => {
    await wait();
    await api.download(film.path);
  };
  const done = shots.length - film.missing.value.length;
  const failed = shots.find(({ job }) => job?.state === "failed");
  return (
    <section class="film-progress whole-film" aria-label="All shots" data-state={film.ready.value ? "succeeded" : ""}>
      <div class="film-progress-text">
        <strong>{film.ready.value ? "Finished" : `${done} of ${shots.length}`}</strong>
        <span>{film.ready.value ? "The film of all shots, with sound" : "shots are painted"}</span>
      </div>
      {film.notes.value.length > 0 && (
        <details class="film-notes">
          <summary>The shots differ in size or frame rate</summary>
          <p class="hint">{film.notes.value.join(" ")}</p>
        </details>
      )}
      <ol class="shot-progress">
        {shots.map((one) => (
          <ShotProgress key={one.shot} {...one} onShow={() => (session.shotId.value = one.shot)} />
        ))}
      </ol>
      {failed?.job?.error && (
        <p class="field-error" role="alert">
          {failed.name}: {failed.job.error.message} {failed.job.error.remedy}
        </p>
      )}
      <div class="actions">
        {film.ready.value > 0 && <Watch film={film} wait={wait} />}
        {film.ready.value > 0 && (
          <button type="button" class="button small" onClick={() => save().catch(notify)}>
            Download the film
          </button>
        )}
        {joining !== null && <span class="hint" role="status">{`Joining the shots: ${percent(joining)}`}</span>}
        {film.painting.value && (
          <button type="button" class="button small" onClick={() => film.cancel().catch(notify)}>
            Cancel all
          </button>
        )}
      </div>
    </section>
  );
}

function ShotProgress({ name, job, onShow }: ShotFilm & { onShow(): void }) {
  const state = !job ? "not painted" : isFinal(job) ? stateWord(job).toLowerCase() : percent(job.progress);
  return (
    <li data-state={job?.state ?? ""} style={{ "--done": job ? (job.state === "succeeded" ? 1 : job.progress) : 0 }}>
      <button type="button" title={`${name}: ${state}`} aria-label={`${name}: ${state}`} onClick={onShow} />
    </li>
  );
}

/** The film in a dialog, with the browser's controls. */
function Watch({ film, wait }: { film: Film; wait(): Promise<void> }) {
  const dialog = useRef<HTMLDialogElement>(null);
  const [src, setSrc] = useState("");
  const open = async () => {
    await wait();
    setSrc(await api.mediaUrl(film.path));
    dialog.current?.showModal();
  };
  const closed = () => {
    if (src.startsWith("blob:")) URL.revokeObjectURL(src);
    setSrc("");
  };
  return (
    <>
      <button type="button" class="button small primary" onClick={() => open().catch(notify)}>
        Watch the film
      </button>
      <dialog ref={dialog} class="watch" aria-label="The film" onClose={closed}>
        {src && <video src={src} controls autoplay playsInline muted={false} aria-label="The painted film" />}
        <form method="dialog">
          <button type="submit" class="button">
            Close
          </button>
        </form>
      </dialog>
    </>
  );
}

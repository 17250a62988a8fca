/** The film that is painted now: how far it is, its newest frame, and the way to see it on the stage. */

import type { Job } from "../../api/schemas";
import { isFinal, progressText, stateWord } from "../../jobs/progress";
import { percent } from "../../ui/format";
import { IconButton } from "../../ui/icons";
import { notify } from "../../ui/notices";
import { titleOf } from "../document/shots";
import type { Store } from "../state/store";
import type { Films } from "./films";

export function FilmProgress({ store, films }: { store: Store; films: Films }) {
  const state = films.current.value;
  const several = store.document.value.shots.length > 1;
  const told = several && films.present && state?.job.state === "succeeded";
  if (!state || told) return null; // the film of all shots says it
  const { job, queue } = state;
  const [first, end] = job.request.frames ?? [0, store.frames];
  const newest = films.newest.value;
  const show = () => {
    store.tool.value = "pan";
    store.goTo(Math.min(Math.max(first, store.frame.value), end - 1));
    store.stageView.value = "film";
  };
  return (
    <section class="film-progress" aria-label="The film" data-state={job.state}>
      {newest && <img src={newest.src} alt="The newest finished frame" />}
      <div class="film-progress-text">
        <strong>{isFinal(job) ? stateWord(job) : percent(job.progress)}</strong>
        <span>
          {several && `${titleOf(store.document.value, store.shotId)}: `}
          {isFinal(job) ? endText(job) : progressText(job, queue)}
        </span>
        {isFinal(job) && <IconButton name="close" label="Close this message" onClick={() => films.dismiss()} />}
        {!isFinal(job) && <progress max={1} value={job.progress} aria-label="Progress of the film" />}
      </div>
      <div class="actions">
        {(newest || job.state === "succeeded") && (
          <button type="button" class={`button small ${newest ? "" : "primary"}`} onClick={show}>
            Show it on the stage
          </button>
        )}
        {!isFinal(job) && (
          <button type="button" class="button small" onClick={() => films.cancel().catch(notify)}>
            {several ? "Cancel this shot" : "Cancel"}
          </button>
        )}
        <a class="button small" href={`#/jobs/${job.id}`}>
          Page of the film
        </a>
      </div>
    </section>
  );
}

/** Its fault, or its range of frames. */
function endText({ error, request }: Job): string {
  if (error) return [error.message, error.remedy].filter(Boolean).join(" ");
  return request.frames ? `Frames ${request.frames[0] + 1} to ${request.frames[1]}` : "";
}

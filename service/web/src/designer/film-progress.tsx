/** The film that is painted now: how far it is, its newest frame, and, once it is finished, the way to see it. */

import { useEffect, useState } from "preact/hooks";
import * as api from "../shared/api";
import { percent } from "../shared/format";
import { notify } from "../shared/notices";
import type { Job } from "../shared/types";
import { isFinal, progressText, stateWord } from "../works/progress";
import type { Films } from "./films";
import { IconButton } from "./icon";
import type { Store } from "./store";

const PICTURE_MS = 1000;

export function FilmProgress({ store, films }: { store: Store; films: Films }) {
  const state = films.current.value;
  if (!state) return null;
  const { job, queue } = state;
  const [first, end] = job.request.frames ?? [0, store.frames];
  const show = () => {
    store.tool.value = "pan";
    store.goTo(Math.min(Math.max(first, store.frame.value), end - 1));
    store.stageView.value = "film";
  };
  return (
    <section class="film-progress" aria-label="The film" data-state={job.state}>
      <NewestFrame job={job} />
      <div class="film-progress-text">
        <strong>{isFinal(job) ? stateWord(job) : percent(job.progress)}</strong>
        <span>{isFinal(job) ? endText(job) : progressText(job, queue)}</span>
        {isFinal(job) && <IconButton name="close" label="Close this message" onClick={() => films.dismiss()} />}
        {!isFinal(job) && <progress max={1} value={job.progress} aria-label="Progress of the film" />}
      </div>
      <div class="actions">
        {job.state === "succeeded" && (
          <button type="button" class="button small primary" onClick={show}>
            Show it on the stage
          </button>
        )}
        {!isFinal(job) && (
          <button type="button" class="button small" onClick={() => films.cancel().catch(notify)}>
            Cancel
          </button>
        )}
        <a class="button small" href={`#/jobs/${job.id}`}>
          Page of the film
        </a>
      </div>
    </section>
  );
}

/** What is wrong with it, or which frames it has. */
function endText({ error, request }: Job): string {
  if (error) return [error.message, error.remedy].filter(Boolean).join(" ");
  return request.frames ? `Frames ${request.frames[0] + 1} to ${request.frames[1]}` : "";
}

/** The newest finished frame, while the film is painted. */
function NewestFrame({ job }: { job: Job }) {
  const [picture, setPicture] = useState("");
  const painted = !isFinal(job) && job.results.includes("preview");
  useEffect(() => {
    if (!painted) return;
    const controller = new AbortController();
    let timer = 0;
    const load = async () => {
      const url = await api.objectUrl(api.paths.file(job.id, "preview"), controller.signal).catch(() => "");
      if (controller.signal.aborted) return URL.revokeObjectURL(url);
      if (url) setPicture(url);
      timer = window.setTimeout(load, PICTURE_MS);
    };
    load();
    return () => {
      controller.abort();
      clearTimeout(timer);
    };
  }, [job.id, painted]);
  useEffect(() => () => URL.revokeObjectURL(picture), [picture]);
  return painted && picture ? <img src={picture} alt="The newest finished frame" /> : null;
}

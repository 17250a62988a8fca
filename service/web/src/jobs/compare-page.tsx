/** Films of several jobs side by side in the wipe, for example of a project's variants. */

import { useEffect, useState } from "preact/hooks";
import * as api from "../api/api";
import { outputOf } from "../api/formats";
import type { Job } from "../api/schemas";
import { percent } from "../ui/format";
import { notify, ProblemBlock } from "../ui/notices";
import { Player, type PlayerProps } from "./player";
import { isFinal, stateWord } from "./progress";

const POLL_MS = 1500;

export function ComparePage({ ids }: { ids: string[] }) {
  const [jobs, setJobs] = useState<Job[]>([]);
  const [problem, setProblem] = useState<api.Problem | null>(null);
  const [chosen, setChosen] = useState<[string, string]>(["", ""]);
  useEffect(() => {
    const controller = new AbortController();
    let timer = 0;
    const load = async () => {
      try {
        const read = await Promise.all(ids.map((id) => api.job(id, controller.signal)));
        setJobs(read);
        if (read.some((job) => !isFinal(job))) timer = window.setTimeout(load, POLL_MS);
      } catch (error) {
        if (!api.isAbort(error)) setProblem(api.asProblem(error));
      }
    };
    load();
    return () => {
      controller.abort();
      clearTimeout(timer);
    };
  }, [ids.join()]);

  const finished = jobs.filter((job) => job.state === "succeeded" && playable(job));
  const sides = [0, 1].map((i) => finished.find((job) => job.id === chosen[i]) ?? finished[i]);
  const [left, right] = sides;
  if (problem)
    return (
      <div class="compare-page">
        <ProblemBlock error={problem} />
      </div>
    );
  return (
    <div class="compare-page">
      <h1>Compare films</h1>
      <div class="compare-choices" hidden={!left || !right}>
        <Choice label="Left film" jobs={finished} chosen={left} onChoose={(id) => setChosen([id, right?.id ?? ""])} />
        <Choice label="Right film" jobs={finished} chosen={right} onChoose={(id) => setChosen([left?.id ?? "", id])} />
      </div>
      <div class="result">
        {left && right ? (
          <Films key={`${left.id} ${right.id}`} left={left} right={right} />
        ) : (
          <p class="compare-wait" role="status">
            Two films are needed for a comparison.
          </p>
        )}
      </div>
      <ul class="compare-list">
        {jobs.map((job) => (
          <Entry key={job.id} job={job} />
        ))}
      </ul>
    </div>
  );
}

function Films({ left, right }: { left: Job; right: Job }) {
  const [films, setFilms] = useState<PlayerProps | null>(null);
  useEffect(() => {
    let closed = false;
    const read = async () => {
      const asset = await api.asset(left.request.inputs.video ?? "");
      const [before = "", after = ""] = await Promise.all(
        [left, right].map((job) => api.mediaUrl(api.paths.result(job.id))),
      );
      if (!closed) setFilms({ asset, before, after, labels: [shortName(left), shortName(right)] });
    };
    read().catch(notify);
    return () => {
      closed = true;
    };
  }, []);
  return films && <Player {...films} />;
}

const playable = (job: Job): boolean => outputOf(job.request.output?.format).shownAs === "video";

/** The variant's name, which is the last part of the job's. */
const shortName = (job: Job): string => job.request.name.split(": ").at(-1) || job.request.method;

function Entry({ job }: { job: Job }) {
  const state = isFinal(job) ? stateWord(job) : `${stateWord(job)}, ${percent(job.progress)}`;
  return (
    <li>
      <a href={`#/jobs/${job.id}`}>{job.request.name || job.request.method}</a>
      <span>{playable(job) ? state : `${state}: only MP4 and WebM can be compared`}</span>
    </li>
  );
}

interface ChoiceProps {
  label: string;
  jobs: Job[];
  chosen: Job | undefined;
  onChoose(id: string): void;
}

function Choice({ label, jobs, chosen, onChoose }: ChoiceProps) {
  return (
    <label class="inline-field">
      {label}
      <select value={chosen?.id ?? ""} onChange={(event) => onChoose(event.currentTarget.value)}>
        {jobs.map((job) => (
          <option key={job.id} value={job.id}>
            {shortName(job)}
          </option>
        ))}
      </select>
    </label>
  );
}

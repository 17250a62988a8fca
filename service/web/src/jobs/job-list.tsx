/** The works: cards of all jobs, newest first; the service searches them by words and by state. */

import type { ComponentChildren } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import * as api from "../api/api";
import type { Job } from "../api/schemas";
import { ago, percent } from "../ui/format";
import { Icon, IconButton } from "../ui/icons";
import { useMediaUrl } from "../ui/media";
import { notify, offerUndo, ProblemBlock } from "../ui/notices";
import { isFinal, stateWord } from "./progress";

/** Between two requests while a listed job is not final. */
const POLL_MS = 2500;
/** Between two requests otherwise: jobs submitted or deleted elsewhere, or by this page before a reload. */
const IDLE_POLL_MS = 10_000;
/** After the last letter of a search. */
const REST_MS = 250;
const STATES: [string, string][] = [
  ["", "All"],
  ["active", "Running"],
  ["succeeded", "Finished"],
  ["failed", "Failed"],
];

export interface JobListProps {
  /** Jobs a page. */
  limit: number;
  /** Whether there are search, filter, and a button for older jobs. */
  more?: boolean;
  /** Shown while there are no jobs. */
  empty: ComponentChildren;
}

export function JobList({ limit, more = false, empty }: JobListProps) {
  const [wanted, setWanted] = useState<api.JobSearch>({});
  const { jobs, cursor, problem, refresh, older } = useJobs(limit, wanted);
  const chosen = Object.keys(wanted).length > 0;
  if (problem)
    return (
      <div>
        <ProblemBlock error={problem}>
          <button type="button" class="button" onClick={() => location.reload()}>
            Try again
          </button>
        </ProblemBlock>
      </div>
    );
  return (
    <div aria-busy={!jobs}>
      {more && <Filter wanted={wanted} onChange={setWanted} />}
      <p class="works-none" role="status" hidden={!jobs || jobs.length > 0 || !chosen}>
        No work matches.
      </p>
      <ul class="works">
        {jobs
          ? jobs.map((job) => <Card key={job.id} job={job} changed={refresh} />)
          : Array.from({ length: Math.min(limit, 4) }, (_, i) => (
              <li key={i} class="work skeleton" aria-hidden="true" />
            ))}
      </ul>
      <div class="works-rest">
        {jobs && !jobs.length && !chosen && empty}
        {more && cursor && (
          <button type="button" class="button" onClick={() => older(cursor).catch(notify)}>
            Show more
          </button>
        )}
      </div>
    </div>
  );
}

interface Listed {
  /** By id; null until they are read. */
  jobs: ReadonlyMap<string, Job> | null;
  /** Of the page after the last one that is shown. */
  cursor: string | null;
  pages: number;
}

/** The jobs that match, newest first, read again and again. */
function useJobs(limit: number, wanted: api.JobSearch) {
  const [listed, setListed] = useState<Listed>({ jobs: null, cursor: null, pages: 1 });
  const [problem, setProblem] = useState<api.Problem | null>(null);
  const read = useRef(() => {});
  useEffect(() => {
    let closed = false;
    let timer = 0;
    let known = false;
    const load = async () => {
      clearTimeout(timer);
      try {
        const page = await api.jobs(limit, wanted);
        if (closed) return;
        const first = !known;
        known = true;
        setListed((old) => withNewest(first ? { jobs: null, cursor: null, pages: 1 } : old, page));
        timer = window.setTimeout(load, page.items.some((job) => !isFinal(job)) ? POLL_MS : IDLE_POLL_MS);
      } catch (error) {
        if (closed) return;
        if (known) timer = window.setTimeout(load, IDLE_POLL_MS);
        else setProblem(api.asProblem(error));
      }
    };
    read.current = load;
    timer = window.setTimeout(load, listed.jobs ? REST_MS : 0);
    return () => {
      closed = true;
      clearTimeout(timer);
    };
  }, [limit, wanted]);

  const current = useRef(wanted);
  current.current = wanted;
  const older = async (cursor: string) => {
    const page = await api.jobs(limit, wanted, cursor);
    if (current.current !== wanted) return; // another search has begun
    setListed(({ jobs, pages }) => ({
      jobs: new Map([...(jobs ?? []), ...entries(page.items)]),
      cursor: page.cursor ?? null,
      pages: pages + 1,
    }));
  };
  const jobs = listed.jobs && [...listed.jobs.values()].sort((a, b) => (a.id < b.id ? 1 : -1));
  return { jobs, cursor: listed.cursor, problem, refresh: () => read.current(), older };
}

/** Other formats of a film that is listed are left out. */
const entries = (jobs: Job[]): [string, Job][] =>
  jobs.filter((job) => !job.request.labels?.export).map((job) => [job.id, job]);

/**
 * The first page again: jobs that belong on it and are not there any more were deleted, or have another state.
 */
function withNewest({ jobs, cursor, pages }: Listed, page: { items: Job[]; cursor?: string | null }): Listed {
  const oldest = page.cursor ? (page.items.at(-1)?.id ?? "") : "";
  const kept = [...(jobs ?? [])].filter(([id]) => id < oldest);
  return {
    jobs: new Map([...kept, ...entries(page.items)]),
    cursor: pages === 1 ? (page.cursor ?? null) : cursor,
    pages,
  };
}

function Filter({ wanted, onChange }: { wanted: api.JobSearch; onChange(wanted: api.JobSearch): void }) {
  const change = (part: { search?: string; state?: string }) => {
    const { search = "", state = "" } = { ...wanted, ...part };
    onChange({ ...(search && { search }), ...(state && { state: state as NonNullable<api.JobSearch["state"]> }) });
  };
  return (
    <div class="works-filter">
      <input
        type="search"
        placeholder="Name, method or label"
        aria-label="Search works"
        onInput={(event) => change({ search: event.currentTarget.value.trim() })}
      />
      <select aria-label="Works to show" onChange={(event) => change({ state: event.currentTarget.value })}>
        {STATES.map(([value, title]) => (
          <option key={value} value={value}>
            {title}
          </option>
        ))}
      </select>
    </div>
  );
}

/** Labels that a user gave a job; the others say where it came from. */
export const ownLabels = ({ request }: Job): string[] =>
  Object.entries(request.labels ?? {}).flatMap(([name, value]) =>
    ["project", "shot", "content", "variant", "version", "export"].includes(name)
      ? []
      : [value ? `${name}: ${value}` : name],
  );

function Card({ job, changed }: { job: Job; changed(): void }) {
  const [deleted, setDeleted] = useState(false);
  const name = job.request.name || job.request.method;
  const remove = () => {
    setDeleted(true);
    deleteWithUndo(job.id, name, () => setDeleted(false));
  };
  return (
    <li class={`work ${deleted ? "deleted" : ""}`} data-state={job.state}>
      <a href={`#/jobs/${job.id}`} class="work-link">
        <Poster job={job} />
        <span class="work-bar" style={{ "--done": job.progress }} />
        <span class="work-title">{name}</span>
        <span class="work-state">{stateLine(job)}</span>
        <span class="work-labels">
          {ownLabels(job).map((label) => (
            <span key={label}>{label}</span>
          ))}
        </span>
      </a>
      <div class="work-actions">
        {["failed", "cancelled"].includes(job.state) && (
          <IconButton
            name="retry"
            label={`Try ${name} again`}
            onClick={() => api.act(job.id, "retry").then(changed, notify)}
          />
        )}
        {isFinal(job) && <IconButton name="trash" label={`Delete ${name}`} onClick={remove} />}
      </div>
    </li>
  );
}

/** The painted frame, or a frame of the source until there is one. */
function Poster({ job }: { job: Job }) {
  const [broken, setBroken] = useState("");
  const file = ["poster", "preview"].find((name) => job.results.includes(name));
  const video = job.request.inputs.video;
  const url = useMediaUrl(file ? api.paths.file(job.id, file) : video ? api.paths.frame(video, 0, 480) : "");
  return (
    <span class="work-poster">
      {url && broken !== url ? (
        <img src={url} alt="" loading="lazy" class={file ? "" : "pending"} onError={() => setBroken(url)} />
      ) : (
        <Icon name="brush" />
      )}
    </span>
  );
}

function stateLine(job: Job): string {
  if (job.state === "running") return `Painting, ${percent(job.progress)}`;
  return job.state === "succeeded" ? ago(job.created_at) : `${stateWord(job)} · ${ago(job.created_at)}`;
}

/** Delete a job after a few seconds in which the user can undo it. */
export function deleteWithUndo(id: string, name: string, undo: () => void): void {
  offerUndo(`Deleted “${name}”.`, undo, () => api.forget(id).catch(notify));
}

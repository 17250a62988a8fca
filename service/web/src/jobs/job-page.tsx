/** The page of one job: its progress while it runs, and the player when it is done. */

import { useEffect, useState } from "preact/hooks";
import * as api from "../api/api";
import { outputOf } from "../api/formats";
import type { Job, Method, Page } from "../api/schemas";
import { hashOfJob } from "../forms/draft";
import { ago, percent } from "../ui/format";
import { IconButton } from "../ui/icons";
import { type Message, notify, ProblemBlock, WarningBlock } from "../ui/notices";
import { Facts } from "./facts";
import { deleteWithUndo } from "./job-list";
import { JobPreview } from "./job-preview";
import { isFinal, Progress, type Queue, stateWord } from "./progress";
import { Downloads, Result } from "./result";
import { watchJob } from "./watch-job";

const GONE = { title: "This job does not exist", message: "It was deleted, or it belongs to another key.", remedy: "" };
const LOSSY = "The frame is taken from the compressed film. A film in PNG frames gives its exact pixels.";

export function JobPage({ id }: { id: string }) {
  const { job, queue, problem, act } = useJob(id);
  const [frame, setFrame] = useState<number | null>(null);
  useEffect(() => {
    if (job) document.title = `${isFinal(job) ? stateWord(job) : percent(job.progress)} · ${titleOf(job)} · Impasto`;
  }, [job]);
  if (!job) return <Unknown problem={problem} />;
  const done = job.state === "succeeded";
  return (
    <div class="job" aria-busy="false">
      <div class="studio">
        <div class="studio-stage">
          <div class="film-head">
            <div class="film-title">
              <h1>{titleOf(job)}</h1>
              <p>{`${stateWord(job)} · started ${ago(job.created_at)}`}</p>
            </div>
          </div>
          {done ? <Result job={job} onframe={setFrame} /> : <JobPreview job={job} />}
        </div>
        <aside class="panel job-panel" aria-label="Progress">
          {job.error && <ProblemBlock error={{ title: "The job failed", ...job.error }} />}
          <WarningBlock title="Damaged input" messages={job.warnings.map((warning) => warning.message)} />
          {done && <Downloads job={job} />}
          {done && <Correction job={job} shown={frame} />}
          <Progress job={job} queue={queue} />
          <Verbs job={job} act={act} />
          <Facts job={job} />
        </aside>
      </div>
    </div>
  );
}

function Unknown({ problem }: { problem: Message | null }) {
  return (
    <div class="job" aria-busy={!problem}>
      {problem ? (
        <div class="failure">
          <ProblemBlock error={problem}>
            <a class="button" href="#/jobs">
              All works
            </a>
            <a class="button" href="#/">
              To the studio
            </a>
          </ProblemBlock>
        </div>
      ) : (
        <div class="loading">Loading the job…</div>
      )}
    </div>
  );
}

/** The job as it is now, why it cannot be read, and actions on it. */
function useJob(id: string) {
  const [shown, setShown] = useState<{ job: Job | null; queue: Queue | null }>({ job: null, queue: null });
  const [problem, setProblem] = useState<Message | null>(null);
  const [watched, setWatched] = useState(0);
  useEffect(() => {
    const controller = new AbortController();
    const onchange = (job: Job, queue: Queue | null) => setShown({ job, queue });
    const onmissing = (found: api.Problem) => setProblem(found.status === 404 ? GONE : found);
    watchJob(id, { onchange, onmissing }, controller.signal);
    return () => controller.abort();
  }, [id, watched]);
  const act = async (verb: api.JobVerb) => {
    await api.act(id, verb).then((job) => setShown({ job, queue: null }), notify);
    if (verb === "retry") setWatched(watched + 1);
  };
  return { ...shown, problem, act };
}

function Verbs({ job, act }: { job: Job; act(verb: api.JobVerb): Promise<void> }) {
  const [acting, setActing] = useState(false);
  const button = (verb: api.JobVerb, text: string, style = "") => (
    <button
      key={verb}
      type="button"
      class={`button ${style}`}
      disabled={acting}
      onClick={() => {
        setActing(true);
        act(verb).finally(() => setActing(false));
      }}
    >
      {text}
    </button>
  );
  const change = (style = "") => (
    <a class={`button ${style}`} href={hashOfJob(job)}>
      Change settings
    </a>
  );
  const remove = () => {
    location.hash = "#/jobs";
    deleteWithUndo(job.id, titleOf(job), () => history.back());
  };
  const again = retryMayHelp(job);
  return (
    <div class="actions">
      {job.state === "paused" && button("resume", "Resume", "primary")}
      {!isFinal(job) && job.state !== "paused" && button("pause", "Pause")}
      {!isFinal(job) && button("cancel", "Cancel")}
      {job.state === "succeeded" && change()}
      {job.state === "succeeded" && <CompareLink job={job} />}
      {["failed", "cancelled"].includes(job.state) &&
        (again
          ? [button("retry", "Try again", "primary"), change()]
          : [change("primary"), button("retry", "Try again")])}
      {isFinal(job) && <IconButton name="trash" label={`Delete ${titleOf(job)}`} disabled={acting} onClick={remove} />}
    </div>
  );
}

/** A link to the page that compares the film with those of the project's other variants, once there are two. */
function CompareLink({ job }: { job: Job }) {
  const [others, setOthers] = useState<string[]>([]);
  const { project, variant } = job.request.labels;
  useEffect(() => {
    if (project && variant) otherVariants(project, variant).then(setOthers, notify);
  }, [job.id]);
  if (!others.length) return null;
  return (
    <a class="button" href={`#/compare/${[job.id, ...others].join(",")}`}>
      Compare variants
    </a>
  );
}

/** The newest finished film of each other variant. */
async function otherVariants(project: string, variant: string): Promise<string[]> {
  const label = `project:${project}`;
  const { items } = await api.get<Page<Job>>(api.url`/v1/jobs?label=${label}&state=succeeded&limit=50`);
  const newest = new Map<string, string>();
  for (const one of items) {
    const name = one.request.labels.variant;
    if (name && !newest.has(name)) newest.set(name, one.id);
  }
  newest.delete(variant);
  return [...newest.values()];
}

/** Choose a frame of the film that becomes a key of its project. `shown`: where the player stands. */
function Correction({ job, shown }: { job: Job; shown: number | null }) {
  const first = job.request.frames?.[0] ?? 0;
  const [frame, setFrame] = useState(first + 1);
  const [keyed, setKeyed] = useState(false);
  const { project } = job.request.labels;
  useEffect(() => {
    if (shown !== null) setFrame(first + 1 + shown);
  }, [shown]);
  useEffect(() => {
    const usesKeys = ({ name, studio }: Method) =>
      name === job.request.method && studio.sections.some(({ editor }) => editor === "keys");
    if (project) api.methods().then((methods) => setKeyed(methods.some(usesKeys)), notify);
  }, [project]);
  if (!project || !keyed) return null;
  const open = () => {
    location.hash = `#/projects/${project}?film=${job.id}&frame=${Math.max(first, frame - 1)}`;
  };
  return (
    <div class="correct-frame">
      <label>
        {"Frame "}
        <input
          type="number"
          min={first + 1}
          value={frame}
          aria-label="Frame to correct"
          onInput={(event) => setFrame(event.currentTarget.valueAsNumber)}
        />
      </label>
      <button type="button" class="button" onClick={open}>
        Correct this frame
      </button>
      {outputOf(job.request.output?.format).hasQuality && <p class="hint">{LOSSY}</p>}
    </div>
  );
}

const titleOf = (job: Job): string => job.request.name || job.request.method;

/** Faults of the request come back however often it is tried; crashes and lost machines may not. */
function retryMayHelp({ state, error }: Job): boolean {
  if (state === "cancelled" || !error) return true;
  return !USER_ERRORS.has(error.code);
}

const USER_ERRORS = new Set([
  "bad-input",
  "bad-parameter",
  "bad-media",
  "unreadable-media",
  "damaged-media",
  "no-video-stream",
  "media-too-large",
  "bad-frame",
  "not-found",
]);

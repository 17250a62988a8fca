/** Progress of a job: the whole, its steps, the time left. */

import { useEffect, useRef } from "preact/hooks";
import type { Job, RunState, Schemas, Step } from "../api/schemas";
import { duration, percent, remaining } from "../ui/format";
import { Icon } from "../ui/icons";
import { announce } from "../ui/notices";

const WORDS: Record<RunState, string> = {
  queued: "Queued",
  running: "Painting",
  paused: "Paused",
  succeeded: "Finished",
  failed: "Failed",
  cancelled: "Cancelled",
};

/** The state of a job in words. */
export const stateWord = (job: Job): string => WORDS[job.state] ?? job.state;
export const isFinal = (job: Job): boolean => ["succeeded", "failed", "cancelled"].includes(job.state);

/** How many jobs are served before one, and what they need, seconds. */
export type Queue = Schemas["QueuePosition"];

/** `queue`: the job's position, if it is known. */
export function Progress({ job, queue }: { job: Job; queue: Queue | null }) {
  useNarration(job);
  return (
    <div class="progress" data-state={job.state}>
      <div class="progress-head">
        <strong class="progress-number">{percent(job.progress)}</strong>
        <span class="progress-hint">{progressText(job, queue)}</span>
      </div>
      <progress max={1} value={job.progress} aria-label="Progress of the film" />
      <ol class="steps">
        {job.steps.map((step) => (
          <StepRow key={step.name} step={step} />
        ))}
      </ol>
    </div>
  );
}

/** "Queued, 2 jobs ahead, about 4 min". */
export function queueText(queue: Queue | null): string {
  if (!queue) return "Queued";
  if (!queue.jobs_ahead) return "Queued, next in line";
  const jobs = `${queue.more ? "more than " : ""}${queue.jobs_ahead} ${queue.jobs_ahead === 1 ? "job" : "jobs"} ahead`;
  if (queue.seconds === null || queue.more) return `Queued, ${jobs}`;
  const minutes = Math.round(queue.seconds / 60);
  return `Queued, ${jobs}, ${minutes < 1 ? "less than a minute" : `about ${duration(60 * minutes)}`}`;
}

/** What happens to a job, in words: its position while it is queued, the time left while it is painted. */
export const progressText = (job: Job, queue: Queue | null): string =>
  job.state === "queued" ? queueText(queue) : timeLeft(job);

/** Seconds in which a shown time left moves most of the way to a new estimate. */
const SETTLE_S = 20;
/** The time left of a job as it was shown last: seconds, and when, seconds. */
const shownLeft = new Map<string, { left: number; at: number }>();

/** The time left to show, seconds: it runs down with the clock, and moves towards new estimates without a jump. */
export function steadyLeft(job: string, eta: number, now = performance.now() / 1000): number {
  const before = shownLeft.get(job);
  const elapsed = before ? now - before.at : 0;
  const expected = before ? Math.max(0, before.left - elapsed) : eta;
  const left = eta + (expected - eta) * Math.exp(-elapsed / SETTLE_S);
  shownLeft.set(job, { left, at: now });
  return left;
}

function timeLeft(job: Job): string {
  if (job.state !== "running") {
    shownLeft.delete(job.id);
    return stateWord(job);
  }
  const known = job.eta_s !== null && job.eta_s !== undefined;
  return known ? remaining(steadyLeft(job.id, job.eta_s ?? 0)) : "estimating the time left";
}

/** Tell assistive technology of each new state and step, not of every percent. */
function useNarration(job: Job): void {
  const state = useRef("");
  const step = job.steps.find((candidate) => candidate.state === "running")?.title;
  useEffect(() => {
    if (state.current !== job.state) announce(stateWord(job));
    else if (step) announce(`Now: ${step}`);
    state.current = job.state;
  }, [job.state, step]);
}

function StepRow({ step }: { step: Step }) {
  const total = Object.values(step.counts).reduce((sum, n) => sum + n, 0);
  const tasks = total > 1 && `${step.counts.succeeded ?? 0} of ${total} tasks`;
  const reused = step.reused ? `${step.reused} of ${total} tasks reused` : "";
  const seconds = step.state === "succeeded" && step.seconds > 0 && duration(step.seconds);
  return (
    <li class="step" data-state={step.state} aria-label={`${step.title}: ${step.state}, ${percent(step.progress)}`}>
      <span class="step-mark">
        {step.state === "succeeded" && <Icon name="check" />}
        {step.state === "failed" && <Icon name="alert" />}
      </span>
      <span class="step-title">{step.title}</span>
      <span class="step-hint">{reused || seconds || tasks || ""}</span>
      <span class="step-bar" style={{ "--done": step.progress }} />
    </li>
  );
}

/** Progress of a job: the whole, its steps, the time left. */

import { h } from "../shared/dom";
import { duration, percent, remaining } from "../shared/format";
import { icon } from "../shared/icons";
import { announce } from "../shared/notices";
import type { Job, RunState, Step } from "../shared/types";

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

export interface Progress {
  element: HTMLElement;
  /** Show the job; `queue`: its position, if it is known. */
  update(job: Job, queue?: Queue | null): void;
}

/** How many jobs are served before one, and what they need, seconds. */
export interface Queue {
  jobs_ahead: number;
  /** Whether there are more than `jobs_ahead`, which are not counted. */
  more?: boolean;
  seconds: number | null;
}

export function createProgress(): Progress {
  const bar = h("progress", { max: 1, value: 0, "aria-label": "Progress of the film" });
  const number = h("strong", { class: "progress-number" });
  const text = h("span", { class: "progress-hint" });
  const steps = h("ol", { class: "steps" });
  const head = h("div", { class: "progress-head" }, number, text);
  const element = h("div", { class: "progress" }, head, bar, steps);
  const announced = { step: "", state: "" };
  return {
    element,
    update(job, queue = null) {
      bar.value = job.progress;
      number.textContent = percent(job.progress);
      text.textContent = progressText(job, queue);
      element.dataset.state = job.state;
      steps.replaceChildren(...job.steps.map(stepRow));
      narrate(job, announced);
    },
  };
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

function timeLeft(job: Job): string {
  if (job.state !== "running") return stateWord(job);
  return job.eta_s === null || job.eta_s === undefined ? "estimating the time left" : remaining(job.eta_s);
}

/** Tell assistive technology of each new state and step, not of every percent. */
function narrate(job: Job, announced: { step: string; state: string }): void {
  const step = job.steps.find((candidate) => candidate.state === "running")?.title ?? announced.step;
  if (announced.state !== job.state) announce(stateWord(job));
  else if (announced.step !== step) announce(`Now: ${step}`);
  Object.assign(announced, { step, state: job.state });
}

function stepRow(step: Step): HTMLElement {
  const total = Object.values(step.counts ?? {}).reduce((sum, n) => sum + n, 0);
  const tasks = total > 1 && `${step.counts.succeeded ?? 0} of ${total} tasks`;
  const reused = step.reused ? `${step.reused} of ${total} tasks taken over` : "";
  const seconds = step.state === "succeeded" && step.seconds > 0 && duration(step.seconds);
  const bar = h("span", { class: "step-bar" });
  bar.style.setProperty("--done", String(step.progress));
  const symbol = step.state === "succeeded" ? icon("check") : step.state === "failed" ? icon("alert") : "";
  const mark = h("span", { class: "step-mark" }, symbol);
  const title = h("span", { class: "step-title" }, step.title);
  const row = h(
    "li",
    { class: "step" },
    mark,
    title,
    h("span", { class: "step-hint" }, reused || seconds || tasks || ""),
    bar,
  );
  row.dataset.state = step.state;
  row.setAttribute("aria-label", `${step.title}: ${step.state}, ${percent(step.progress)}`);
  return row;
}

/** How a job is coming along: the whole, its steps, the time left. */

import { h, icon } from "./dom.js";
import { duration, percent, remaining } from "./format.js";
import { announce } from "./notices.js";

const WORDS = { queued: "Waiting its turn", running: "Painting", paused: "Paused", succeeded: "Finished", failed: "It failed", cancelled: "Cancelled" };

/** The state of a job in words. */
export const stateWord = (job) => WORDS[job.state] ?? job.state;
export const isFinal = (job) => ["succeeded", "failed", "cancelled"].includes(job.state);

/** @returns {{element, update(job)}} */
export function createProgress() {
  const bar = h("progress", { max: 1, value: 0, "aria-label": "Progress of the film" });
  const number = h("strong", { class: "progress-number" });
  const note = h("span", { class: "progress-note" });
  const steps = h("ol", { class: "steps" });
  const element = h("div", { class: "progress" }, h("div", { class: "progress-head" }, number, note), bar, steps);
  const said = { step: "", state: "" };
  return {
    element,
    update(job) {
      bar.value = job.progress;
      number.textContent = percent(job.progress);
      note.textContent = noteOf(job);
      element.dataset.state = job.state;
      steps.replaceChildren(...job.steps.map(stepRow));
      narrate(job, said);
    },
  };
}

function noteOf(job) {
  if (job.state !== "running") return stateWord(job);
  return job.eta_s === null || job.eta_s === undefined ? "working out how long it takes" : remaining(job.eta_s);
}

/** Tell assistive technology of each new state and step, not of every percent. */
function narrate(job, said) {
  const step = job.steps.find((s) => s.state === "running")?.title ?? said.step;
  if (said.state !== job.state) announce(stateWord(job));
  else if (said.step !== step) announce(`Now: ${step}`);
  Object.assign(said, { step, state: job.state });
}

function stepRow(step) {
  const total = Object.values(step.counts ?? {}).reduce((sum, n) => sum + n, 0);
  const tasks = total > 1 && `${step.counts.succeeded ?? 0} of ${total} tasks`;
  const seconds = step.state === "succeeded" && step.seconds > 0 && duration(step.seconds);
  const bar = h("span", { class: "step-bar" });
  bar.style.setProperty("--done", String(step.progress));
  const mark = h("span", { class: "step-mark" }, step.state === "succeeded" ? icon("check") : step.state === "failed" ? icon("alert") : "");
  const row = h("li", { class: "step" }, mark, h("span", { class: "step-title" }, step.title), h("span", { class: "step-note" }, seconds || tasks || ""), bar);
  row.dataset.state = step.state;
  row.setAttribute("aria-label", `${step.title}: ${step.state}, ${percent(step.progress)}`);
  return row;
}

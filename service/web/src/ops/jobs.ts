/** The newest jobs of everyone, and live sessions, with buttons to cancel and end them. */

import { act, type JobVerb } from "../shared/api";
import { under } from "../shared/base";
import { confirmButton, plainButton } from "../shared/confirm";
import { type Child, h } from "../shared/dom";
import { ago, duration, percent } from "../shared/format";
import { notify } from "../shared/notices";
import type { Job } from "../shared/types";
import { isFinal } from "../works/progress";
import * as ops from "./api";
import { createSelection } from "./selection";
import { createTable, type Updated } from "./table";
import type { BoardCalls, LiveSession } from "./types";

export function createJobs({ again, onjob }: BoardCalls): Updated<Job> {
  const selection = createSelection(again);
  const table = createTable<Job>({
    name: "jobs",
    columns: ["Job", "Owner", "Priority", "State", "Done", "Left", "Tasks", ""],
    empty: "No such job.",
    key: (job) => job.id,
    state: (job) => job.state,
    cells: (job) => [
      [job.id, () => h("div", { class: "job-name" }, selection.target(job), h("div", {}, identity(job, onjob)))],
      job.owner,
      [`${priorityOf(job)} ${isFinal(job)}`, () => (isFinal(job) ? String(priorityOf(job)) : priority(job, again))],
      [job.state + (job.error?.code ?? ""), () => stateBadge(job)],
      percent(job.progress),
      isFinal(job) || job.eta_s === null ? "" : duration(job.eta_s),
      tasks(job.counts),
      [job.state, () => h("div", { class: "actions" }, verbs(job, again))],
    ],
  });
  return {
    element: h("div", { class: "jobs-list" }, selection.element, table.element),
    update(jobs) {
      selection.listed(jobs);
      table.update(jobs);
    },
  };
}

const priorityOf = (job: Job): number => job.request.priority ?? 0;

/** A field for the priority; the job is served anew by it when the field is left. */
function priority(job: Job, again: () => void): HTMLElement {
  const label = `Priority of ${job.request.name || job.request.method}`;
  const field = h("input", { type: "number", class: "priority", min: -100, max: 100, step: 1, "aria-label": label });
  field.value = String(priorityOf(job));
  field.addEventListener("change", async () => {
    if (field.reportValidity()) await ops.setPriority(job.id, Math.round(field.valueAsNumber || 0)).catch(notify);
    again();
  });
  return field;
}

function identity(job: Job, onjob: (id: string) => void): Child {
  const { name, method } = job.request;
  const parts = [name && method, ago(job.created_at)];
  return [
    h("button", { type: "button", class: "link", onclick: () => onjob(job.id) }, name || method),
    h("small", {}, parts.filter(Boolean).join(" · ")),
  ];
}

const stateBadge = (job: Job): Child => [
  h("span", { class: "badge", "data-state": job.state }, job.state),
  job.error && h("small", {}, job.error.code),
];

function tasks(counts: Record<string, number>): string {
  const total = Object.values(counts).reduce((sum, n) => sum + n, 0);
  return `${counts.succeeded} of ${total}${counts.failed ? `, ${counts.failed} failed` : ""}`;
}

function verbs(job: Job, again: () => void): Child[] {
  const plain = (label: string, verb: JobVerb) => plainButton({ label, act: () => act(job.id, verb), done: again });
  if (isFinal(job)) return job.state === "succeeded" ? [] : [plain("Retry", "retry")];
  const cancel = confirmButton({
    label: "Cancel",
    title: `Cancel ${job.request.name || job.request.method}?`,
    text: "It stops within a second. Finished tasks are kept, so that it can be retried.",
    danger: true,
    act: () => act(job.id, "cancel"),
    done: again,
  });
  const first = plainButton({ label: "First", act: () => ops.setPriority(job.id, null), done: again });
  first.title = "Move to the front of the queue: a priority above all other unfinished jobs";
  return [first, job.state === "paused" ? plain("Resume", "resume") : plain("Pause", "pause"), cancel];
}

export function createLive({ again }: BoardCalls): Updated<LiveSession> {
  return createTable<LiveSession>({
    name: "live",
    columns: ["Session", "Frames", "Latency", "Dropped", ""],
    empty: "No live session is open.",
    key: (session) => session.id,
    cells: (session) => [
      [session.id + session.connected, () => sessionIdentity(session)],
      `${session.figures.painted ?? 0} · ${session.figures.fps ?? 0} fps`,
      latency(session.figures.latency_ms),
      String(session.figures.dropped ?? 0),
      [String(session.ending), () => (session.ending ? "ending" : endButton(session, again))],
    ],
  });
}

function sessionIdentity(session: LiveSession): Child {
  const size = `${session.width} × ${session.height}`;
  const parts = [session.owner, size, ago(session.opened_at), !session.connected && "waits for its client"];
  const link = h("a", { href: under(`/live/view?session=${encodeURIComponent(session.id)}`) }, session.method);
  return [link, h("small", {}, parts.filter(Boolean).join(" · "))];
}

function endButton(session: LiveSession, again: () => void): HTMLElement {
  return confirmButton({
    label: "End",
    title: "End this live session?",
    text: "Its client gets the message that an operator has ended it.",
    danger: true,
    act: () => ops.endLive(session.id),
    done: again,
  });
}

const latency = (ms: Record<string, number> | undefined): string =>
  ms ? `p50 ${ms.p50} · p95 ${ms.p95} · p99 ${ms.p99} ms` : "";

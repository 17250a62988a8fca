/** The newest jobs of everyone, and live sessions, with buttons to cancel and end them. */

import { act, type JobVerb } from "../shared/api";
import { confirmButton, plainButton } from "../shared/confirm";
import { type Child, h } from "../shared/dom";
import { ago, percent } from "../shared/format";
import type { Job } from "../shared/types";
import { isFinal } from "../works/progress";
import * as ops from "./api";
import { createTable, type Updated } from "./table";
import type { BoardCalls, LiveSession } from "./types";

export function createJobs({ again, onjob }: BoardCalls): Updated<Job> {
  return createTable<Job>({
    name: "jobs",
    columns: ["Job", "State", "Done", "Tasks", ""],
    empty: "No such job.",
    key: (job) => job.id,
    state: (job) => job.state,
    cells: (job) => [
      [job.id, () => identity(job, onjob)],
      [job.state + (job.error?.code ?? ""), () => stateBadge(job)],
      percent(job.progress),
      tasks(job.counts),
      [job.state, () => h("div", { class: "actions" }, verbs(job, again))],
    ],
  });
}

function identity(job: Job, onjob: (id: string) => void): Child {
  const { name, method, priority } = job.request;
  const parts = [name && method, job.owner, priority && `priority ${priority}`, ago(job.created_at)];
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
  return [job.state === "paused" ? plain("Resume", "resume") : plain("Pause", "pause"), cancel];
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
  return [h("strong", {}, session.method), h("small", {}, parts.filter(Boolean).join(" · "))];
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

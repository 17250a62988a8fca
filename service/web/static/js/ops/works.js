/** The newest jobs of everyone, and live sessions: looked at, cancelled, ended. */

import { act } from "../api.js";
import { h } from "../dom.js";
import { ago, percent } from "../format.js";
import { isFinal } from "../progress.js";
import * as ops from "./api.js";
import { plainButton, sureButton } from "./sure.js";
import { createTable } from "./table.js";

/** @returns {{element, update(jobs)}} */
export function createWorks({ again, onjob }) {
  return createTable({
    name: "jobs",
    columns: ["Job", "State", "Done", "Tasks", ""],
    empty: "No such job.",
    key: (job) => job.id,
    cells: (job) => [
      [job.id, () => [h("button", { type: "button", class: "link", onclick: () => onjob(job.id) }, job.request.name || job.request.method), h("small", {}, [job.request.name && job.request.method, job.owner, job.request.priority && `priority ${job.request.priority}`, ago(job.created_at)].filter(Boolean).join(" · "))]],
      [job.state + (job.error?.code ?? ""), () => [h("span", { class: "badge", "data-state": job.state }, job.state), job.error && h("small", {}, job.error.code)]],
      percent(job.progress),
      tasks(job.counts),
      [job.state, () => h("div", { class: "actions" }, verbs(job, again))],
    ],
  });
}

function tasks(counts) {
  const total = Object.values(counts).reduce((sum, n) => sum + n, 0);
  const failed = counts.failed ? `, ${counts.failed} failed` : "";
  return `${counts.succeeded} of ${total}${failed}`;
}

function verbs(job, again) {
  const title = job.request.name || job.request.method;
  const plain = (label, verb) => plainButton({ label, act: () => act(job.id, verb), done: again });
  const cancel = sureButton({ label: "Cancel", title: `Cancel ${title}?`, text: "It stops within a second. What is done is kept, so that it can be retried.", danger: true, act: () => act(job.id, "cancel"), done: again });
  if (isFinal(job)) return job.state === "succeeded" ? [] : [plain("Retry", "retry")];
  return [job.state === "paused" ? plain("Resume", "resume") : plain("Pause", "pause"), cancel];
}

/** @returns {{element, update(sessions)}} */
export function createLive({ again }) {
  return createTable({
    name: "live",
    columns: ["Session", "Frames", "Latency", "Dropped", ""],
    empty: "Nobody is live.",
    key: (session) => session.id,
    cells: (session) => [
      [session.id + session.connected, () => [h("strong", {}, session.method), h("small", {}, [session.owner, `${session.width} × ${session.height}`, ago(session.opened_at), !session.connected && "waits for its client"].filter(Boolean).join(" · "))]],
      `${session.figures.painted ?? 0} · ${session.figures.fps ?? 0} fps`,
      latency(session.figures.latency_ms),
      String(session.figures.dropped ?? 0),
      [String(session.ending), () => (session.ending ? "ending" : sureButton({ label: "End", title: "End this live session?", text: "Its client is told that an operator has ended it.", danger: true, act: () => ops.endLive(session.id), done: again }))],
    ],
  });
}

const latency = (ms) => (ms ? `p50 ${ms.p50} · p95 ${ms.p95} · p99 ${ms.p99} ms` : "");

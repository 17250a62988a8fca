/** Workers (processes) and machines: their state, their tasks, and buttons to drain them. */

import { confirmButton, plainButton } from "../ui/confirm";
import { type Child, h } from "../ui/dom";
import { ago, percent } from "../ui/format";
import * as ops from "./api";
import { createTable, type Updated } from "./table";
import type { BoardCalls, Drain, NodeView, TaskRun, Worker } from "./types";

const DRAINED =
  "Its running tasks are finished, and no new task starts there until you resume it. Other workers take its tasks.";

export function createWorkers({ again, onjob }: BoardCalls): Updated<Worker> {
  return createTable<Worker>({
    name: "workers",
    columns: ["Worker", "State", "Slots", "Running", ""],
    empty: "No worker is here. Start one with `impasto worker`, or with `impasto serve`.",
    key: (worker) => worker.id,
    state: (worker) => worker.state,
    cells: (worker) => [
      [worker.id + worker.host + worker.role + worker.version, () => identity(worker)],
      [state(worker) + worker.state, () => badge(worker.state, state(worker))],
      `${worker.at_work.length} / ${worker.slots.length}${worker.kind === "ray" ? " on Ray" : ""}`,
      [JSON.stringify(worker.at_work), () => worker.at_work.map((run) => taskLine(run, onjob))],
      [String(worker.drain === null) + worker.state, () => workerButton(worker, again)],
    ],
  });
}

export function createNodes({ again }: BoardCalls): Updated<NodeView> {
  return createTable<NodeView>({
    name: "machines",
    columns: ["Machine", "State", "Slots", "Resources", ""],
    empty: "No machine offers a slot.",
    key: (node) => node.name,
    state: (node) => node.state,
    cells: (node) => [
      node.name,
      [node.state + (node.drain?.reason ?? ""), () => badge(node.state, reasonOf(node.drain))],
      `${node.busy} / ${node.slots}`,
      resources(node),
      [String(node.drain === null), () => drainButton("nodes", node.name, node.name, node.drain, again)],
    ],
  });
}

function workerButton(worker: Worker, again: () => void): Child {
  if (!worker.drain && worker.state === "away") return "";
  return drainButton("workers", worker.id, worker.host, worker.drain, again);
}

function drainButton(kind: ops.PlaceKind, name: string, shown: string, drain: Drain | null, again: () => void): Child {
  if (drain) return plainButton({ label: "Resume", act: () => ops.resume(kind, name), done: again });
  const act = (reason: string) => ops.drain(kind, name, reason);
  return confirmButton({ label: "Drain", title: `Drain ${shown}?`, text: DRAINED, why: true, act, done: again });
}

const reasonOf = (drain: Drain | null): string => (drain ? [drain.by, drain.reason].filter(Boolean).join(": ") : "");

function state(worker: Worker): string {
  if (worker.state === "away") return `silent since ${ago(worker.seen_at)}`;
  return reasonOf(worker.drain) || `since ${ago(worker.started_at)}`;
}

const badge = (word: string, more: string): Child => [
  h("span", { class: "badge", "data-state": word }, word),
  more && h("small", {}, more),
];

const ROLES: Record<string, string> = { worker: "worker", serve: "service" };

/** Host, role, version and short id; a worker that has just registered has no role yet. */
function identity(worker: Worker): Child {
  const role = ROLES[worker.role] ?? "starting";
  const parts = [role, worker.version && `version ${worker.version}`, shortId(worker.id)];
  return [h("strong", {}, worker.host), h("small", {}, parts.filter(Boolean).join(" · "))];
}

/** The end of the id's random part, which distinguishes workers of a host. */
export const shortId = (id: string): string => (id.split("@")[0] ?? "").slice(-6);

function taskLine(run: TaskRun, onjob: (id: string) => void): HTMLElement {
  const text = `${run.method} · ${run.step} · ${run.key}`;
  const open = h("button", { type: "button", class: "link", onclick: () => onjob(run.job_id) }, text);
  const parts = [percent(run.progress), run.number > 1 && `attempt ${run.number}`, run.slot || "on its way"];
  return h("div", { class: "work-line" }, open, h("small", {}, parts.filter(Boolean).join(" · ")));
}

function resources({ cpus, gpus, memory_bytes: memory }: NodeView): string {
  return [`${cpus} CPU`, gpus && `${gpus} GPU`, memory && `${(memory / 2 ** 30).toFixed(1)} GiB`]
    .filter(Boolean)
    .join(", ");
}

/** Workers (processes) and machines: who is there, what they do, and draining them. */

import { h } from "../dom.js";
import { ago, percent } from "../format.js";
import * as ops from "./api.js";
import { plainButton, sureButton } from "./sure.js";
import { createTable } from "./table.js";

const DRAINED = "What runs there is finished, and nothing new starts until you resume it. Its tasks go to others.";

/** @returns {{element, update(workers)}} */
export function createWorkers({ again, onjob }) {
  return createTable({
    name: "workers",
    columns: ["Worker", "State", "Slots", "At work", ""],
    empty: "No worker is here. Start one with `impasto worker`, or with `impasto serve`.",
    key: (worker) => worker.id,
    cells: (worker) => [
      [worker.id, () => named(worker.host, worker.role === "worker" ? "worker" : "service", worker.version && `version ${worker.version}`, shortId(worker.id))],
      [state(worker) + worker.state, () => badge(worker.state, state(worker))],
      `${worker.at_work.length} / ${worker.slots.length}${worker.kind === "ray" ? " on Ray" : ""}`,
      [JSON.stringify(worker.at_work), () => worker.at_work.map((work) => workLine(work, onjob))],
      [String(worker.drain === null) + worker.state, () => button("workers", worker.id, worker.host, worker.drain, worker.state !== "away", again)],
    ],
  });
}

/** @returns {{element, update(nodes)}} */
export function createNodes({ again }) {
  return createTable({
    name: "machines",
    columns: ["Machine", "State", "Slots", "Resources", ""],
    empty: "No machine offers a slot.",
    key: (node) => node.name,
    cells: (node) => [
      node.name,
      [node.state + (node.drain?.reason ?? ""), () => badge(node.state, said(node.drain))],
      `${node.busy} / ${node.slots}`,
      resources(node),
      [String(node.drain === null), () => button("nodes", node.name, node.name, node.drain, true, again)],
    ],
  });
}

function button(kind, name, shown, drain, possible, again) {
  if (drain) return plainButton({ label: "Resume", act: () => ops.resume(kind, name), done: again });
  if (!possible) return "";
  return sureButton({ label: "Drain", title: `Drain ${shown}?`, text: DRAINED, why: true, act: (reason) => ops.drain(kind, name, reason), done: again });
}

const state = (worker) => (worker.state === "away" ? `silent since ${ago(worker.seen_at)}` : said(worker.drain) || `since ${ago(worker.started_at)}`);
const said = (drain) => (drain ? [drain.by, drain.reason].filter(Boolean).join(": ") : "");

const badge = (word, note) => [h("span", { class: "badge", "data-state": word }, word), note && h("small", {}, note)];

const named = (name, ...notes) => [h("strong", {}, name), h("small", {}, notes.filter(Boolean).join(" · "))];

/** What tells a worker from another of its host: the end of its random part. */
export const shortId = (id) => id.split("@")[0].slice(-6);

function workLine(work, onjob) {
  const open = h("button", { type: "button", class: "link", onclick: () => onjob(work.job_id) }, `${work.method} · ${work.step} · ${work.key}`);
  return h("div", { class: "work-line" }, open, h("small", {}, [percent(work.progress), work.number > 1 && `attempt ${work.number}`, work.slot || "on its way"].filter(Boolean).join(" · ")));
}

function resources({ cpus, gpus, memory_bytes: memory }) {
  return [`${cpus} CPU`, gpus && `${gpus} GPU`, memory && `${(memory / 2 ** 30).toFixed(1)} GiB`].filter(Boolean).join(", ");
}

/** What operators ask of the service and tell it. All of it needs an admin key. */

import { request } from "../api.js";

const path = (strings, ...values) => String.raw({ raw: strings }, ...values.map(encodeURIComponent));
const get = async (where, signal) => (await request(where, { signal })).json();
const items = async (where, signal) => (await get(where, signal)).items;

function post(where, body) {
  const options = body === undefined ? {} : { headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) };
  return request(where, { method: "POST", ...options });
}

/** Everything the board shows, read at about the same time. */
export async function look(jobState, signal) {
  const jobs = `/v1/jobs?limit=12${jobState && path`&state=${jobState}`}`;
  const [snapshot, queue, workers, nodes, live, failures, shown, ready] = await Promise.all([
    get("/v1/ops/snapshot", signal),
    get("/v1/ops/queue", signal),
    items("/v1/ops/workers?limit=200", signal),
    items("/v1/ops/nodes", signal),
    items("/v1/ops/live?limit=200", signal),
    items("/v1/ops/failures?limit=20", signal),
    items(jobs, signal),
    readiness(signal),
  ]);
  return { snapshot, queue, workers, nodes, live, failures, jobs: shown, ready };
}

/** Part -> "ok" or what is wrong; the answer is 503 when something is. */
async function readiness(signal) {
  const response = await fetch("/readyz", { signal });
  return (await response.json().catch(() => ({}))).parts ?? {};
}

const MOST_BARS = 1000;
/** The latest attempts of a job. */
export const timeline = (jobId, signal) => items(path`/v1/ops/jobs/${jobId}/timeline?limit=` + MOST_BARS, signal);
export const attemptLog = (id) => get(path`/v1/ops/attempts/${id}/log`);

export const pauseQueue = (reason) => post("/v1/ops/queue/pause", { reason });
export const resumeQueue = () => post("/v1/ops/queue/resume");
/** `kind`: "workers" or "nodes". */
export const drain = (kind, name, reason) => post(path`/v1/ops/${kind}/${name}/drain`, { reason });
export const resume = (kind, name) => post(path`/v1/ops/${kind}/${name}/resume`);
export const requeue = (taskId) => post(path`/v1/tasks/${taskId}/requeue`);
export const endLive = (id) => post(path`/v1/ops/live/${id}/end`);

/** Requests of operators. All of them need an admin key. */

import { get, post, request, url } from "../shared/api";
import type { Job, Page } from "../shared/types";
import type { Bar, Failure, LiveSession, NodeView, Overview, Queue, Snapshot, Worker } from "./types";

const items = async <Item>(path: string, signal?: AbortSignal): Promise<Item[]> =>
  (await get<Page<Item>>(path, signal)).items;

const send = (path: string): Promise<Response> => request(path, { method: "POST" });

export async function readOverview(jobState: string, signal?: AbortSignal): Promise<Overview> {
  const jobsPath = `/v1/jobs?limit=12${jobState && url`&state=${jobState}`}`;
  const [snapshot, queue, workers, nodes, live, failures, jobs, ready] = await Promise.all([
    get<Snapshot>("/v1/ops/snapshot", signal),
    get<Queue>("/v1/ops/queue", signal),
    items<Worker>("/v1/ops/workers?limit=200", signal),
    items<NodeView>("/v1/ops/nodes", signal),
    items<LiveSession>("/v1/ops/live?limit=200", signal),
    items<Failure>("/v1/ops/failures?limit=20", signal),
    items<Job>(jobsPath, signal),
    readiness(signal),
  ]);
  return { snapshot, queue, workers, nodes, live, failures, jobs, ready };
}

/** Part -> "ok" or its fault; the answer is 503 when a part does not work. */
async function readiness(signal?: AbortSignal): Promise<Record<string, string>> {
  const response = await fetch("/readyz", { signal: signal ?? null });
  return (await response.json().catch(() => ({}))).parts ?? {};
}

const MOST_BARS = 1000;
/** The latest attempts of a job. */
export const timeline = (jobId: string, signal?: AbortSignal): Promise<Bar[]> =>
  items(url`/v1/ops/jobs/${jobId}/timeline?limit=${MOST_BARS}`, signal);
export const attemptLog = (id: string): Promise<{ log: string }> => get(url`/v1/ops/attempts/${id}/log`);

export const pauseQueue = (reason: string): Promise<Response> => post("/v1/ops/queue/pause", { reason });
export const resumeQueue = (): Promise<Response> => send("/v1/ops/queue/resume");
export type PlaceKind = "workers" | "nodes";
export const drain = (kind: PlaceKind, name: string, reason: string): Promise<Response> =>
  post(url`/v1/ops/${kind}/${name}/drain`, { reason });
export const resume = (kind: PlaceKind, name: string): Promise<Response> => send(url`/v1/ops/${kind}/${name}/resume`);
export const requeue = (taskId: string): Promise<Response> => send(url`/v1/tasks/${taskId}/requeue`);
export const endLive = (id: string): Promise<Response> => send(url`/v1/ops/live/${id}/end`);

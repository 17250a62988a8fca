/** Requests of operators. All of them need an admin key. */

import { under } from "../api/base";
import { bodyOf, client } from "../api/client";
import type { Job, Schemas } from "../api/schemas";
import type { Bar, Failure, LiveSession, NodeView, Overview, Queue, Snapshot, Worker } from "./types";

type Items<Item> = Promise<{ data?: { items: Item[] } }>;
const items = async <Item>(answer: Items<Item>): Promise<Item[]> => (await bodyOf(answer)).items;

/** The job states that the list can be limited to; empty: all. */
export type JobState = Job["state"] | "";

const MOST_JOBS = 25;

/** Which jobs the list shows. `search`: a part of the id, name, method or owner. */
export interface JobFilter {
  state: JobState;
  search: string;
}

export async function readOverview({ state, search }: JobFilter, signal?: AbortSignal): Promise<Overview> {
  const options = { signal: signal ?? null };
  const page = (limit: number) => ({ ...options, params: { query: { limit } } });
  const ofJobs = { limit: MOST_JOBS, ...(state && { state }), ...(search && { search }) };
  const [snapshot, queue, machine, workers, nodes, live, failures, jobs, ready] = await Promise.all([
    bodyOf(client.GET("/v1/ops/snapshot", options)),
    bodyOf(client.GET("/v1/ops/queue", options)),
    bodyOf(client.GET("/v1/ops/machine", options)),
    items(client.GET("/v1/ops/workers", page(200))),
    items(client.GET("/v1/ops/nodes", options)),
    items(client.GET("/v1/ops/live", page(200))),
    items(client.GET("/v1/ops/failures", page(20))),
    items(client.GET("/v1/jobs", { ...options, params: { query: ofJobs } })),
    readiness(signal),
  ]);
  return {
    snapshot: snapshot as unknown as Snapshot,
    queue: queue as Queue,
    machine,
    workers: workers as Worker[],
    nodes: nodes as NodeView[],
    live: live as LiveSession[],
    failures: failures as Failure[],
    jobs: jobs as Job[],
    ready,
  };
}

/** Part -> "ok" or its fault; the answer is 503 when a part does not work. */
async function readiness(signal?: AbortSignal): Promise<Record<string, string>> {
  const response = await fetch(under("/readyz"), { signal: signal ?? null });
  return (await response.json().catch(() => ({}))).parts ?? {};
}

const MOST_BARS = 1000;
/** The latest attempts of a job. */
export const timeline = (jobId: string, signal?: AbortSignal): Promise<Bar[]> =>
  items(
    client.GET("/v1/ops/jobs/{job_id}/timeline", {
      params: { path: { job_id: jobId }, query: { limit: MOST_BARS } },
      signal: signal ?? null,
    }),
  );
export const attemptLog = (id: string): Promise<{ log: string }> =>
  bodyOf(client.GET("/v1/ops/attempts/{attempt_id}/log", { params: { path: { attempt_id: id } } }));

export const pauseQueue = (reason: string) => client.POST("/v1/ops/queue/pause", { body: { reason } });
export const resumeQueue = () => client.POST("/v1/ops/queue/resume");
export type PlaceKind = "workers" | "nodes";
export const drain = (kind: PlaceKind, name: string, reason: string) =>
  kind === "workers"
    ? client.POST("/v1/ops/workers/{worker_id}/drain", { params: { path: { worker_id: name } }, body: { reason } })
    : client.POST("/v1/ops/nodes/{node}/drain", { params: { path: { node: name } }, body: { reason } });
export const resume = (kind: PlaceKind, name: string) =>
  kind === "workers"
    ? client.POST("/v1/ops/workers/{worker_id}/resume", { params: { path: { worker_id: name } } })
    : client.POST("/v1/ops/nodes/{node}/resume", { params: { path: { node: name } } });
export const requeue = (taskId: string) =>
  client.POST("/v1/tasks/{task_id}/requeue", { params: { path: { task_id: taskId } } });
/** `priority`: -100..100; null: one above all other unfinished jobs. */
export const setPriority = (id: string, priority: number | null) =>
  bodyOf(client.POST("/v1/ops/jobs/{job_id}/priority", { params: { path: { job_id: id } }, body: { priority } }));
export type BulkAction = Schemas["JobsActionIn"]["action"];
/** One item for each job, in their order. */
export const bulk = (action: BulkAction, jobs: string[]) =>
  bodyOf(client.POST("/v1/ops/jobs/actions", { body: { action, jobs } }));
export const endLive = (id: string) =>
  client.POST("/v1/ops/live/{session_id}/end", { params: { path: { session_id: id } } });

/** The JSON of /v1/ops. */

import type { Fault, Job, Schemas } from "../api/schemas";

export type Drain = Schemas["Drain"];
export type TaskRun = Schemas["RunningAttempt"];
export type Worker = Schemas["WorkerView"];
export type NodeView = Schemas["NodeView"];
export type Failure = Omit<Schemas["Failure"], "error"> & { error: Fault | null };
/** One attempt on a job's timeline. */
export type Bar = Schemas["TimelineBar"];
export type Queue = Schemas["QueueOut"];

export type LiveSession = Omit<Schemas["LiveView"], "figures"> & {
  figures: { painted?: number; fps?: number; dropped?: number; latency_ms?: Record<string, number> };
};

export interface Snapshot {
  /** The server's clock. */
  at: number;
  jobs: Record<string, number>;
  tasks: Record<string, number>;
  queue: { ready_tasks: number; oldest_s: number | null };
  failures: Record<string, number>;
  frames_per_s: Record<string, number>;
}

export type Machine = Schemas["MachineOut"];

/** Everything that the board shows, read at about the same time. */
export interface Overview {
  snapshot: Snapshot;
  queue: Queue;
  machine: Machine;
  workers: Worker[];
  nodes: NodeView[];
  live: LiveSession[];
  failures: Failure[];
  jobs: Job[];
  /** Part -> "ok" or its fault. */
  ready: Record<string, string>;
}

/** What parts of the board call. */
export interface BoardCalls {
  /** Read everything anew. */
  again(): void;
  /** Show a job's timeline. */
  onjob(id: string): void;
}

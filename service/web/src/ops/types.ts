/** The JSON of /v1/ops. */

import type { Schemas } from "../api/client";
import type { Fault, Job } from "../api/types";

export interface Drain {
  by: string;
  reason: string;
}

export interface TaskRun {
  job_id: string;
  method: string;
  step: string;
  key: string;
  number: number;
  progress: number;
  slot: string;
}

export interface Worker {
  id: string;
  host: string;
  role: string;
  kind: string;
  version: string;
  state: string;
  started_at: number;
  seen_at: number;
  slots: unknown[];
  at_work: TaskRun[];
  drain: Drain | null;
}

export interface NodeView {
  name: string;
  state: string;
  slots: number;
  busy: number;
  cpus: number;
  gpus: number;
  memory_bytes: number;
  drain: Drain | null;
}

export interface Failure {
  attempt_id: string;
  task_id: string;
  job_id: string;
  job_name: string;
  method: string;
  step: string;
  key: string;
  task_state: string;
  number: number;
  outcome: string;
  slot: string;
  started_at: number;
  finished_at: number;
  error: Fault | null;
}

/** One attempt on a job's timeline. */
export interface Bar {
  attempt_id: string;
  step: string;
  key: string;
  number: number;
  worker: string;
  slot: string;
  outcome: string;
  started_at: number;
  finished_at: number | null;
  code: string;
}

export interface LiveSession {
  id: string;
  owner: string;
  method: string;
  width: number;
  height: number;
  opened_at: number;
  connected: boolean;
  figures: { painted?: number; fps?: number; dropped?: number; latency_ms?: Record<string, number> };
  ending: boolean;
}

export interface Snapshot {
  /** The server's clock. */
  at: number;
  jobs: Record<string, number>;
  tasks: Record<string, number>;
  queue: { ready_tasks: number; oldest_s: number | null };
  failures: Record<string, number>;
  frames_per_s: Record<string, number>;
}

export interface Queue {
  paused: boolean;
  drain: Drain | null;
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

/** Following one job: its state after every event, and its position while it is queued. */

import * as api from "../api/api";
import { follow } from "../api/events";
import type { Job } from "../api/schemas";
import { isFinal, type Queue } from "./progress";

const REFRESH_MS = 600;
const QUEUE_MS = 4000;

export interface JobListener {
  /** The job as it is now; `queue`: its position, if it is known. */
  onchange(job: Job, queue: Queue | null): void;
  /** Called if the job cannot be read and has not been read before. `again`: the read is repeated, because the service may recover. */
  onmissing?(problem: api.Problem, again: boolean): void;
}

/** Whether the same request may succeed later, because the service did not answer or was too busy. */
const mayPass = ({ status }: api.Problem): boolean => status === 0 || status === 429 || status >= 500;

/** Follow a job until it is final or `signal` aborts. Readings are limited to a rate that a user can follow. */
export async function watchJob(id: string, { onchange, onmissing }: JobListener, signal: AbortSignal): Promise<void> {
  let job: Job | null = null;
  let queue: Queue | null = null;
  let timer = 0;
  const stop = new AbortController();
  const end = () => {
    clearTimeout(timer);
    stop.abort();
  };
  signal.addEventListener("abort", end, { once: true });

  async function refresh(): Promise<void> {
    try {
      job = await api.job(id, signal);
    } catch (error) {
      if (signal.aborted || job) return;
      const problem = api.asProblem(error);
      onmissing?.(problem, mayPass(problem));
      if (!mayPass(problem)) end();
      return;
    }
    if (signal.aborted) return;
    onchange(job, queue);
    if (job.state === "queued" && !timer) timer = window.setTimeout(readQueue, 0);
    if (isFinal(job)) end();
  }

  /** Read the position now and every few seconds while the job is queued. */
  async function readQueue(): Promise<void> {
    if (stop.signal.aborted || job?.state !== "queued") {
      timer = 0;
      return;
    }
    queue = await api.get<Queue>(api.url`/v1/jobs/${id}/queue`, stop.signal).catch(() => queue);
    if (job?.state === "queued" && !stop.signal.aborted) onchange(job, queue);
    timer = window.setTimeout(readQueue, QUEUE_MS);
  }

  await refresh();
  if (!stop.signal.aborted) await follow(id, throttle(refresh, REFRESH_MS), stop.signal);
}

/** Run `work` at once, then at most once every `ms`; calls in between lead to one more run at the end. */
function throttle(work: () => Promise<void>, ms: number): () => void {
  let waiting = false;
  let again = false;
  const run = async () => {
    if (waiting) {
      again = true;
      return;
    }
    waiting = true;
    again = false;
    await work();
    setTimeout(() => {
      waiting = false;
      if (again) run();
    }, ms);
  };
  return run;
}

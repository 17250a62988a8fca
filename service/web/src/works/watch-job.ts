/** Following one job: its state after every event, and its position while it is queued. */

import * as api from "../shared/api";
import { follow } from "../shared/events";
import type { Job } from "../shared/types";
import { isFinal, type Queue } from "./progress";

const REFRESH_MS = 600;
const QUEUE_MS = 4000;

export interface JobListener {
  /** The job as it is now; `queue`: its position, if it is known. */
  onchange(job: Job, queue: Queue | null): void;
  /** The job cannot be read, and has not been read before. */
  onmissing?(problem: api.Problem): void;
}

/** Follow a job until it is final or `signal` aborts. It is read not more often than the eye can follow. */
export async function watchJob(id: string, { onchange, onmissing }: JobListener, signal: AbortSignal): Promise<void> {
  let job: Job | null = null;
  let queue: Queue | null = null;
  let looking = 0;
  const stop = new AbortController();
  const end = () => {
    clearTimeout(looking);
    stop.abort();
  };
  signal.addEventListener("abort", end, { once: true });

  async function refresh(): Promise<void> {
    try {
      job = await api.job(id, signal);
    } catch (error) {
      if (!signal.aborted && !job) onmissing?.(api.asProblem(error));
      return;
    }
    if (signal.aborted) return;
    onchange(job, queue);
    if (job.state === "queued" && !looking) looking = window.setTimeout(look, 0);
    if (isFinal(job)) end();
  }

  /** Read the position now and every few seconds while the job is queued. */
  async function look(): Promise<void> {
    if (stop.signal.aborted || job?.state !== "queued") {
      looking = 0;
      return;
    }
    queue = await api.get<Queue>(api.url`/v1/jobs/${id}/queue`, stop.signal).catch(() => queue);
    if (job?.state === "queued" && !stop.signal.aborted) onchange(job, queue);
    looking = window.setTimeout(look, QUEUE_MS);
  }

  await refresh();
  if (job && !stop.signal.aborted) await follow(id, throttle(refresh, REFRESH_MS), stop.signal);
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

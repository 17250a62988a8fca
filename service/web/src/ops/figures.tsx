/** The state of the whole service: a row of figures, tasks by state, and whether anything is paused or broken. */

import { ActionButton } from "../ui/dialogs";
import { duration } from "../ui/format";
import * as ops from "./api";
import { Tile, type TileProps } from "./table";
import type { Overview, Queue, Snapshot, Worker } from "./types";

const TASK_STATES = ["running", "ready", "waiting", "failed", "cancelled", "succeeded"];
const count = new Intl.NumberFormat("en", { maximumFractionDigits: 1 });

export function Figures({ overview, again }: { overview: Overview; again(): void }) {
  const { snapshot, queue, workers, ready } = overview;
  return (
    <section aria-label="The queue">
      <div class="queue-state">
        <QueueState queue={queue} again={again} />
      </div>
      <div role="status">
        <ul class="troubles">
          {broken(ready, workers).map((text) => (
            <li key={text}>{text}</li>
          ))}
        </ul>
      </div>
      <dl class="tiles">
        {figures(snapshot, workers).map((figure) => (
          <Tile key={figure.name} {...figure} />
        ))}
      </dl>
      <TaskBar tasks={snapshot.tasks} />
    </section>
  );
}

function QueueState({ queue, again }: { queue: Queue; again(): void }) {
  const { by, reason } = queue.drain ?? {};
  const why = [by && `by ${by}`, reason && `“${reason}”`].filter(Boolean).join(": ");
  return (
    <div class="queue-line" data-paused={queue.paused}>
      <p class="queue-word">
        <strong>{queue.paused ? "Paused" : "Open"}</strong>
        {queue.paused ? ` No task is started. ${why}` : " Tasks are started."}
      </p>
      {queue.paused ? (
        <ActionButton key="resume" label="Resume the queue" act={ops.resumeQueue} done={again} />
      ) : (
        <ActionButton
          key="pause"
          label="Pause the queue"
          confirmation={{
            title: "Pause the queue?",
            text: "No new task will start on any worker. Running tasks are finished; new jobs are accepted and wait.",
            why: true,
          }}
          act={ops.pauseQueue}
          done={again}
        />
      )}
    </div>
  );
}

function broken(ready: Record<string, string>, workers: Worker[]): string[] {
  const parts = Object.entries(ready).filter(([, word]) => word !== "ok");
  const away = workers.filter((worker) => worker.state === "away").length;
  const silent = away ? [`${away} ${away === 1 ? "worker is" : "workers are"} silent.`] : [];
  return [...parts.map(([part, word]) => `${part}: ${word}`), ...silent];
}

function figures({ jobs, tasks, queue, failures, frames_per_s: pace }: Snapshot, workers: Worker[]): TileProps[] {
  const failed = Object.entries(failures);
  const slots = workers
    .filter((worker) => worker.state !== "away")
    .reduce((sum, worker) => sum + worker.slots.length, 0);
  const busy = workers.reduce((sum, worker) => sum + worker.at_work.length, 0);
  const frames = Object.entries(pace).filter(([, rate]) => rate > 0);
  const oldest = queue.oldest_s ? `the oldest for ${duration(queue.oldest_s)}` : "";
  const each = (entries: [string, number][]) => entries.map(([name, n]) => `${name} ${count.format(n)}`).join(", ");
  const fleet = `on ${count.format(workers.length)} ${workers.length === 1 ? "worker" : "workers"}`;
  const paused = jobs.paused ? `${count.format(jobs.paused)} paused` : "";
  return [
    { name: "Jobs queued", value: count.format(jobs.queued ?? 0), more: oldest },
    { name: "Jobs running", value: count.format(jobs.running ?? 0), more: paused },
    {
      name: "Tasks ready",
      value: count.format(queue.ready_tasks),
      more: `${count.format(tasks.waiting ?? 0)} wait for others`,
    },
    { name: "Slots busy", value: `${busy} / ${slots}`, more: fleet },
    { name: "Frames a second", value: count.format(total(frames)), more: each(frames) },
    { name: "Failures, 15 min", value: count.format(total(failed)), more: each(failed) },
  ];
}

const total = (entries: [string, number][]): number => entries.reduce((sum, [, n]) => sum + n, 0);

function TaskBar({ tasks }: { tasks: Record<string, number> }) {
  const of = (state: string) => tasks[state] ?? 0;
  return (
    <div class="task-states">
      <h2>Tasks by state</h2>
      <div class="task-bar" role="img" aria-label={TASK_STATES.map((state) => `${of(state)} ${state}`).join(", ")}>
        {TASK_STATES.filter((state) => of(state) > 0).map((state) => (
          <span
            key={state}
            data-state={state}
            title={`${count.format(of(state))} ${state}`}
            style={{ flexGrow: of(state) }}
          />
        ))}
      </div>
      <ul class="legend">
        {TASK_STATES.map((state) => (
          <li key={state} data-state={state}>
            <span>{state}</span>
            <strong>{count.format(of(state))}</strong>
          </li>
        ))}
      </ul>
    </div>
  );
}

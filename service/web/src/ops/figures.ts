/** The state of the whole service: a row of figures, tasks by state, and whether anything is paused or broken. */

import { confirmButton, plainButton } from "../ui/confirm";
import { type Child, fill, h } from "../ui/dom";
import { duration } from "../ui/format";
import * as ops from "./api";
import type { BoardCalls, Overview, Queue, Snapshot, Worker } from "./types";

const TASK_STATES = ["running", "ready", "waiting", "failed", "cancelled", "succeeded"];
const count = new Intl.NumberFormat("en", { maximumFractionDigits: 1 });

export interface FiguresPart {
  element: HTMLElement;
  update(overview: Overview): void;
}

export function createFigures({ again }: BoardCalls): FiguresPart {
  const state = h("div", { class: "queue-state" });
  const tiles = h("dl", { class: "tiles" });
  const tasks = createTaskBar();
  const troubles = h("ul", { class: "troubles" });
  const element = h(
    "section",
    { "aria-label": "The queue" },
    state,
    h("div", { role: "status" }, troubles),
    tiles,
    tasks.element,
  );
  let drawn = "";
  return {
    element,
    update({ snapshot, queue, workers, ready }) {
      if (drawn !== JSON.stringify(queue)) fill(state, queueState(queue, again));
      drawn = JSON.stringify(queue);
      fill(
        troubles,
        broken(ready, workers).map((text) => h("li", {}, text)),
      );
      fill(tiles, figures(snapshot, workers).map(tile));
      tasks.update(snapshot.tasks);
    },
  };
}

function queueState(queue: Queue, again: () => void): HTMLElement {
  const by = [queue.drain?.by && `by ${queue.drain.by}`, queue.drain?.reason && `“${queue.drain.reason}”`]
    .filter(Boolean)
    .join(": ");
  const text = queue.paused ? ` No task is started. ${by}` : " Tasks are started.";
  const word = h("p", { class: "queue-word" }, h("strong", {}, queue.paused ? "Paused" : "Open"), text);
  const button = queue.paused
    ? plainButton({ label: "Resume the queue", act: ops.resumeQueue, done: again })
    : pauseButton(again);
  const box = h("div", { class: "queue-line" }, word, button);
  box.dataset.paused = String(queue.paused);
  return box;
}

function pauseButton(again: () => void): HTMLElement {
  const text = "No new task will start on any worker. Running tasks are finished; new jobs are accepted and wait.";
  return confirmButton({
    label: "Pause the queue",
    title: "Pause the queue?",
    text,
    why: true,
    act: ops.pauseQueue,
    done: again,
  });
}

function broken(ready: Record<string, string>, workers: Worker[]): string[] {
  const parts = Object.entries(ready).filter(([, word]) => word !== "ok");
  const away = workers.filter((worker) => worker.state === "away").length;
  const silent = away ? [`${away} ${away === 1 ? "worker is" : "workers are"} silent.`] : [];
  return [...parts.map(([part, word]) => `${part}: ${word}`), ...silent];
}

type Figure = [name: string, value: string, more: string];

function figures({ jobs, tasks, queue, failures, frames_per_s: pace }: Snapshot, workers: Worker[]): Figure[] {
  const failed = Object.entries(failures);
  const slots = workers
    .filter((worker) => worker.state !== "away")
    .reduce((sum, worker) => sum + worker.slots.length, 0);
  const busy = workers.reduce((sum, worker) => sum + worker.at_work.length, 0);
  const frames = Object.entries(pace).filter(([, rate]) => rate > 0);
  const paused = jobs.paused ? `${count.format(jobs.paused)} paused` : "";
  return [
    ["Jobs queued", count.format(jobs.queued ?? 0), queue.oldest_s ? `the oldest for ${duration(queue.oldest_s)}` : ""],
    ["Jobs running", count.format(jobs.running ?? 0), paused],
    ["Tasks ready", count.format(queue.ready_tasks), `${count.format(tasks.waiting ?? 0)} wait for others`],
    [
      "Slots busy",
      `${busy} / ${slots}`,
      `on ${count.format(workers.length)} ${workers.length === 1 ? "worker" : "workers"}`,
    ],
    [
      "Frames a second",
      count.format(total(frames)),
      frames.map(([name, rate]) => `${name} ${count.format(rate)}`).join(", "),
    ],
    ["Failures, 15 min", count.format(total(failed)), failed.map(([code, n]) => `${code} ${n}`).join(", ")],
  ];
}

const total = (entries: [string, number][]): number => entries.reduce((sum, [, n]) => sum + n, 0);

const tile = ([name, value, more]: Figure): Child =>
  h("div", { class: "tile" }, h("dt", {}, name), h("dd", {}, value, more && h("small", {}, more)));

function createTaskBar() {
  const bar = h("div", { class: "task-bar", role: "img" });
  const legend = h("ul", { class: "legend" });
  return {
    element: h("div", { class: "task-states" }, h("h2", {}, "Tasks by state"), bar, legend),
    update(tasks: Record<string, number>) {
      const of = (state: string) => tasks[state] ?? 0;
      bar.setAttribute("aria-label", TASK_STATES.map((state) => `${of(state)} ${state}`).join(", "));
      fill(
        bar,
        TASK_STATES.filter((state) => of(state) > 0).map((state) => piece(state, of(state))),
      );
      const entry = (state: string) =>
        h("li", { "data-state": state }, h("span", {}, state), h("strong", {}, count.format(of(state))));
      fill(legend, TASK_STATES.map(entry));
    },
  };
}

function piece(state: string, n: number): HTMLElement {
  const part = h("span", { "data-state": state, title: `${count.format(n)} ${state}` });
  part.style.setProperty("flex-grow", String(n));
  return part;
}

/** The state of the whole: a line of figures, tasks by state, and whether anything is paused or broken. */

import { fill, h } from "../dom.js";
import { duration } from "../format.js";
import * as ops from "./api.js";
import { plainButton, sureButton } from "./sure.js";

const TASK_STATES = ["running", "ready", "waiting", "failed", "cancelled", "succeeded"];
const count = new Intl.NumberFormat("en", { maximumFractionDigits: 1 });

/** @returns {{element, update(look)}} */
export function createFigures({ again }) {
  const state = h("div", { class: "queue-state" });
  const tiles = h("dl", { class: "tiles" });
  const tasks = createTaskBar();
  const troubles = h("ul", { class: "troubles", role: "status" });
  const element = h("section", { "aria-label": "The queue" }, state, troubles, tiles, tasks.element);
  let drawn = "";
  return {
    element,
    update({ snapshot, queue, workers, ready }) {
      if (drawn !== JSON.stringify(queue)) fill(state, queueState(queue, again));
      drawn = JSON.stringify(queue);
      fill(troubles, broken(ready, workers).map((text) => h("li", {}, text)));
      fill(tiles, figures(snapshot, workers).map(([name, value, note]) => h("div", { class: "tile" }, h("dt", {}, name), h("dd", {}, value), note && h("p", {}, note))));
      tasks.update(snapshot.tasks);
    },
  };
}

function queueState(queue, again) {
  const by = queue.drain && [queue.drain.by && `by ${queue.drain.by}`, queue.drain.reason && `“${queue.drain.reason}”`].filter(Boolean).join(": ");
  const word = h("p", { class: "queue-word" }, h("strong", {}, queue.paused ? "Paused" : "Open"), queue.paused ? ` No task is handed out. ${by}` : " Tasks are handed out.");
  const text = "No task will be handed out, to nobody. Those at work are finished; new jobs are accepted and wait.";
  const pause = () => sureButton({ label: "Pause the queue", title: "Pause the queue?", text, why: true, act: ops.pauseQueue, done: again });
  const box = h("div", { class: "queue-line" }, word, queue.paused ? plainButton({ label: "Resume the queue", act: ops.resumeQueue, done: again }) : pause());
  box.dataset.paused = String(queue.paused);
  return box;
}

function broken(ready, workers) {
  const parts = Object.entries(ready).filter(([, word]) => word !== "ok");
  const away = workers.filter((worker) => worker.state === "away").length;
  return [...parts.map(([part, word]) => `${part}: ${word}`), ...(away ? [`${away} ${away === 1 ? "worker is" : "workers are"} silent.`] : [])];
}

function figures({ jobs, tasks, queue, failures, frames_per_s: pace }, workers) {
  const failed = Object.entries(failures);
  const slots = workers.filter((w) => w.state !== "away").reduce((sum, w) => sum + w.slots.length, 0);
  const busy = workers.reduce((sum, w) => sum + w.at_work.length, 0);
  const frames = Object.entries(pace).filter(([, rate]) => rate > 0);
  return [
    ["Jobs queued", count.format(jobs.queued), queue.oldest_s ? `the oldest for ${duration(queue.oldest_s)}` : ""],
    ["Jobs running", count.format(jobs.running), jobs.paused ? `${count.format(jobs.paused)} paused` : ""],
    ["Tasks ready", count.format(queue.ready_tasks), `${count.format(tasks.waiting)} wait for others`],
    ["Slots at work", `${busy} / ${slots}`, `on ${count.format(workers.length)} ${workers.length === 1 ? "worker" : "workers"}`],
    ["Frames a second", count.format(frames.reduce((sum, [, rate]) => sum + rate, 0)), frames.map(([name, rate]) => `${name} ${count.format(rate)}`).join(", ")],
    ["Failures, 15 min", count.format(failed.reduce((sum, [, n]) => sum + n, 0)), failed.map(([code, n]) => `${code} ${n}`).join(", ")],
  ];
}

function createTaskBar() {
  const bar = h("div", { class: "task-bar", role: "img" });
  const legend = h("ul", { class: "legend" });
  return {
    element: h("div", { class: "task-states" }, h("h3", {}, "Tasks by state"), bar, legend),
    update(tasks) {
      const shown = TASK_STATES.filter((state) => tasks[state] > 0);
      bar.setAttribute("aria-label", TASK_STATES.map((state) => `${tasks[state]} ${state}`).join(", "));
      fill(bar, shown.map((state) => part(state, tasks[state])));
      fill(legend, TASK_STATES.map((state) => h("li", { "data-state": state }, h("span", {}, state), h("strong", {}, count.format(tasks[state])))));
    },
  };
}

function part(state, n) {
  const piece = h("span", { "data-state": state, title: `${count.format(n)} ${state}` });
  piece.style.setProperty("flex-grow", String(n));
  return piece;
}

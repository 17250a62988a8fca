/** Attempts that failed, newest first, each with its log opened in place and another try. */

import { fill, h } from "../dom.js";
import { ago, duration } from "../format.js";
import * as ops from "./api.js";
import { plainButton } from "./sure.js";
import { place } from "./table.js";

const RETRIED = ["failed", "cancelled"];

/** @returns {{element, update(failures)}} */
export function createFailures({ again, onjob }) {
  const list = h("ul", { class: "failures" });
  const nothing = h("p", { class: "nothing" }, "Nothing has failed.");
  const rows = new Map();
  return {
    element: h("div", {}, list, nothing),
    update(failures) {
      nothing.hidden = failures.length > 0;
      place(list, rows, failures, (one) => one.attempt_id, (one) => createFailure(one, again, onjob));
    },
  };
}

function createFailure(first, again, onjob) {
  const state = h("span", { class: "badge" });
  const actions = h("div", { class: "actions" });
  const log = createLog(first.attempt_id);
  const what = first.error?.message ?? "Its process died or was cut off.";
  const where = [first.job_name || first.method, first.step, first.key, `attempt ${first.number}`].join(" · ");
  const head = h("div", { class: "failure-head" }, h("div", {}, h("p", { class: "failure-what" }, h("code", {}, first.error?.code ?? first.outcome), ` ${what}`), h("small", {}, `${where} · ran ${duration(first.finished_at - first.started_at)} on ${first.slot || "no slot"} · ${ago(first.finished_at)}`), first.error?.remedy && h("small", { class: "remedy" }, first.error.remedy)), state);
  const element = h("li", { class: "failed" }, head, actions, log.element);
  let drawn = "";
  const update = (one) => {
    if (drawn === one.task_state) return;
    drawn = one.task_state;
    state.dataset.state = one.task_state;
    state.textContent = `task ${one.task_state}`;
    const requeue = plainButton({ label: "Run again", act: () => ops.requeue(one.task_id), done: again });
    const timeline = h("button", { type: "button", class: "button small", onclick: () => onjob(one.job_id) }, "Timeline");
    fill(actions, log.button, timeline, RETRIED.includes(one.task_state) && requeue);
  };
  update(first);
  return { element, update };
}

/** A button, and the log that it opens and closes. */
export function createLog(attemptId) {
  const text = h("pre", { class: "log", tabindex: 0, "aria-label": "Log" });
  const element = h("div", { hidden: true }, text);
  const toggle = async () => {
    element.hidden = !element.hidden;
    button.setAttribute("aria-expanded", String(!element.hidden));
    if (element.hidden || text.textContent) return;
    text.textContent = "Fetching the log…";
    text.textContent = await ops.attemptLog(attemptId).then(({ log }) => log.trimEnd() || "It said nothing.", (problem) => problem.message);
  };
  const button = h("button", { type: "button", class: "button small", "aria-expanded": "false", onclick: toggle }, "Log");
  return { button, element };
}

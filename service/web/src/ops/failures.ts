/** Attempts that failed, newest first, each with its log opened in place and a button to run it again. */

import { asProblem } from "../api/api";
import { plainButton } from "../ui/confirm";
import { fill, h } from "../ui/dom";
import { ago, duration } from "../ui/format";
import * as ops from "./api";
import { place, type Updated } from "./table";
import type { BoardCalls, Failure } from "./types";

const RETRIED = ["failed", "cancelled"];

export function createFailures(calls: BoardCalls): Updated<Failure> {
  const list = h("ul", { class: "failures" });
  const placeholder = h("p", { class: "placeholder" }, "Nothing has failed.");
  const rows = new Map<string, FailureRow>();
  return {
    element: h("div", {}, list, placeholder),
    update(failures) {
      placeholder.hidden = failures.length > 0;
      place(
        list,
        rows,
        failures,
        (one) => one.attempt_id,
        (one) => createFailure(one, calls),
      );
    },
  };
}

interface FailureRow {
  element: HTMLElement;
  update(one: Failure): void;
}

function createFailure(first: Failure, { again, onjob }: BoardCalls): FailureRow {
  const state = h("span", { class: "badge" });
  const actions = h("div", { class: "actions" });
  const log = createLog(first.attempt_id);
  const head = h("div", { class: "failure-head" }, description(first), state);
  const element = h("li", { class: "failed" }, head, actions, log.element);
  let drawn = "";
  const update = (one: Failure) => {
    if (drawn === one.task_state) return;
    drawn = one.task_state;
    state.dataset.state = one.task_state;
    state.textContent = `task ${one.task_state}`;
    const requeue = plainButton({ label: "Run again", act: () => ops.requeue(one.task_id), done: again });
    const timeline = h(
      "button",
      { type: "button", class: "button small", onclick: () => onjob(one.job_id) },
      "Timeline",
    );
    fill(actions, log.button, timeline, RETRIED.includes(one.task_state) && requeue);
  };
  update(first);
  return { element, update };
}

function description(one: Failure): HTMLElement {
  const what = one.error?.message ?? "Its process died or was cut off.";
  const where = [one.job_name || one.method, one.step, one.key, `attempt ${one.number}`].join(" · ");
  const ran = `ran ${duration(one.finished_at - one.started_at)} on ${one.slot || "no slot"} · ${ago(one.finished_at)}`;
  return h(
    "div",
    {},
    h("p", { class: "failure-what" }, h("code", {}, one.error?.code ?? one.outcome), ` ${what}`),
    h("small", {}, `${where} · ${ran}`),
    one.error?.remedy && h("small", { class: "remedy" }, one.error.remedy),
  );
}

export interface Log {
  button: HTMLButtonElement;
  element: HTMLElement;
}

/** A button, and the log that it opens and closes. */
export function createLog(attemptId: string): Log {
  const text = h("pre", { class: "log", tabindex: 0, "aria-label": "Log" });
  const element = h("div", { hidden: true }, text);
  const toggle = async () => {
    element.hidden = !element.hidden;
    button.setAttribute("aria-expanded", String(!element.hidden));
    if (element.hidden || text.textContent) return;
    text.textContent = "Loading the log…";
    text.textContent = await readLog(attemptId);
  };
  const button = h(
    "button",
    { type: "button", class: "button small", "aria-expanded": "false", onclick: toggle },
    "Log",
  );
  return { button, element };
}

async function readLog(attemptId: string): Promise<string> {
  try {
    return (await ops.attemptLog(attemptId)).log.trimEnd() || "The log is empty.";
  } catch (error) {
    return asProblem(error).message;
  }
}

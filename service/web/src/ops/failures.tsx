/** Attempts that failed, newest first, each with its log opened in place and a button to run it again. */

import { useEffect, useState } from "preact/hooks";
import { asProblem } from "../api/api";
import { ActionButton } from "../ui/dialogs";
import { ago, duration } from "../ui/format";
import * as ops from "./api";
import { dotted } from "./table";
import type { BoardCalls, Failure } from "./types";

const RETRIED = ["failed", "cancelled"];

export function Failures({ failures, again, onjob }: { failures: Failure[] } & BoardCalls) {
  if (!failures.length) return <p class="placeholder">Nothing has failed.</p>;
  return (
    <ul class="failures">
      {failures.map((failure) => (
        <FailureRow key={failure.attempt_id} one={failure} again={again} onjob={onjob} />
      ))}
    </ul>
  );
}

function FailureRow({ one, again, onjob }: { one: Failure } & BoardCalls) {
  const [open, setOpen] = useState(false);
  const ran = `ran ${duration(one.finished_at - one.started_at)} on ${one.slot || "no slot"}`;
  return (
    <li class="failed">
      <div class="failure-head">
        <div>
          <p class="failure-what">
            <code>{one.error?.code ?? one.outcome}</code> {one.error?.message ?? "Its process died or was cut off."}
          </p>
          <small>
            {dotted(one.job_name || one.method, one.step, one.key, `attempt ${one.number}`, ran, ago(one.finished_at))}
          </small>
          {one.error?.remedy && <small class="remedy">{one.error.remedy}</small>}
        </div>
        <span class="badge" data-state={one.task_state}>
          task {one.task_state}
        </span>
      </div>
      <div class="actions">
        <LogButton open={open} setOpen={setOpen} />
        <button type="button" class="button small" onClick={() => onjob(one.job_id)}>
          Timeline
        </button>
        {RETRIED.includes(one.task_state) && (
          <ActionButton label="Run again" act={() => ops.requeue(one.task_id)} done={again} />
        )}
      </div>
      {open && <Log attempt={one.attempt_id} />}
    </li>
  );
}

export function LogButton({ open, setOpen }: { open: boolean; setOpen(open: boolean): void }) {
  return (
    <button type="button" class="button small" aria-expanded={open} onClick={() => setOpen(!open)}>
      Log
    </button>
  );
}

/** The log of an attempt. */
export function Log({ attempt }: { attempt: string }) {
  const [text, setText] = useState("Loading the log…");
  useEffect(() => {
    ops.attemptLog(attempt).then(
      ({ log }) => setText(log.trimEnd() || "The log is empty."),
      (error) => setText(asProblem(error).message),
    );
  }, [attempt]);
  return (
    // biome-ignore lint/a11y/noNoninteractiveTabindex: it scrolls, which the keyboard must be able to do
    <pre class="log" role="region" tabIndex={0} aria-label="Log">
      {text}
    </pre>
  );
}

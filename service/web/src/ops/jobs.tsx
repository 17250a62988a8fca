/** The newest jobs of everyone, and live sessions, with buttons to cancel and end them. */

import { useState } from "preact/hooks";
import { act, type JobVerb } from "../api/api";
import { under } from "../api/base";
import type { Job } from "../api/schemas";
import { isFinal } from "../jobs/progress";
import { ActionButton } from "../ui/dialogs";
import { ago, duration, percent } from "../ui/format";
import { notify, notifyOf } from "../ui/notices";
import * as ops from "./api";
import { Badge, dotted, Table } from "./table";
import type { BoardCalls, LiveSession } from "./types";

export function Jobs({ jobs, again, onjob }: { jobs: Job[] } & BoardCalls) {
  const [chosen, setChosen] = useState<ReadonlySet<string>>(new Set());
  const selected = jobs.map(({ id }) => id).filter((id) => chosen.has(id));
  const choose = (id: string, on: boolean) =>
    setChosen(new Set(on ? [...selected, id] : selected.filter((other) => other !== id)));
  return (
    <div class="jobs-list">
      <Selection
        selected={selected}
        select={(ids) => setChosen(new Set(ids))}
        all={jobs.map(({ id }) => id)}
        again={again}
      />
      <Table<Job>
        name="jobs"
        columns={["Job", "Owner", "Priority", "State", "Done", "Left", "Tasks", ""]}
        empty="No such job."
        items={jobs}
        id={(job) => job.id}
        state={(job) => job.state}
        cells={(job) => [
          <div key="" class="job-name">
            <label class="select-target">
              <input
                type="checkbox"
                class="select-job"
                aria-label={`Select ${titleOf(job)}`}
                checked={chosen.has(job.id)}
                onChange={(event) => choose(job.id, event.currentTarget.checked)}
              />
            </label>
            <div>
              <button type="button" class="link" onClick={() => onjob(job.id)}>
                {titleOf(job)}
              </button>
              <small>{dotted(job.request.name && job.request.method, ago(job.created_at))}</small>
            </div>
          </div>,
          job.owner,
          isFinal(job) ? job.request.priority : <Priority key="" job={job} again={again} />,
          <Badge key="" state={job.state}>
            {job.error?.code}
          </Badge>,
          percent(job.progress),
          isFinal(job) || job.eta_s === null ? "" : duration(job.eta_s),
          tasks(job.counts),
          <div key="" class="actions">
            <Verbs job={job} again={again} />
          </div>,
        ]}
      />
    </div>
  );
}

const titleOf = ({ request }: Job): string => request.name || request.method;

interface SelectionProps {
  selected: string[];
  select(ids: string[]): void;
  all: string[];
  again(): void;
}

/** How many jobs are selected, and the buttons that act on all of them. */
function Selection({ selected, select, all, again }: SelectionProps) {
  const bulk = async (action: ops.BulkAction) => {
    const { items } = await ops.bulk(action, selected);
    const refused = items.filter((item) => item.error);
    select(refused.map((item) => item.job_id));
    const reasons = new Set(refused.map(({ error }) => (error ? `${error.message} ${error.remedy}`.trim() : "")));
    if (refused.length) notifyOf({ message: `${refused.length} of ${items.length} jobs: ${[...reasons].join(" ")}` });
  };
  const ask = (label: string, action: ops.BulkAction, text: string) => (
    <ActionButton
      label={label}
      danger
      confirmation={{ title: `${label} the selected jobs?`, text }}
      act={() => bulk(action)}
      done={again}
    />
  );
  return (
    <div class="selection" role="group" aria-label="Selected jobs" hidden={!selected.length}>
      <span role="status">{selected.length === 1 ? "1 job selected" : `${selected.length} jobs selected`}</span>
      {ask("Cancel", "cancel", "They stop within a second. Finished tasks are kept, so that the jobs can be retried.")}
      <ActionButton label="Retry" act={() => bulk("retry")} done={again} />
      {ask(
        "Delete",
        "delete",
        "The jobs that have ended are deleted with their files. Others stay; cancel them first.",
      )}
      <ActionButton label="Select all" act={() => select(all)} />
      <ActionButton label="Select none" act={() => select([])} />
    </div>
  );
}

/** A field for the priority; the job is served anew by it when the field is left. */
function Priority({ job, again }: { job: Job; again(): void }) {
  const change = async (field: HTMLInputElement) => {
    if (field.reportValidity()) await ops.setPriority(job.id, Math.round(field.valueAsNumber || 0)).catch(notify);
    again();
  };
  return (
    <input
      key={job.request.priority}
      type="number"
      class="priority"
      min={-100}
      max={100}
      step={1}
      aria-label={`Priority of ${titleOf(job)}`}
      defaultValue={String(job.request.priority)}
      onChange={(event) => change(event.currentTarget)}
    />
  );
}

function tasks(counts: Record<string, number>): string {
  const total = Object.values(counts).reduce((sum, n) => sum + n, 0);
  return `${counts.succeeded} of ${total}${counts.failed ? `, ${counts.failed} failed` : ""}`;
}

function Verbs({ job, again }: { job: Job; again(): void }) {
  const plain = (label: string, verb: JobVerb) => (
    <ActionButton key={verb} label={label} act={() => act(job.id, verb)} done={again} />
  );
  if (isFinal(job)) return job.state === "succeeded" ? null : plain("Retry", "retry");
  return (
    <>
      <ActionButton
        label="First"
        title="Move to the front of the queue: a priority above all other unfinished jobs"
        act={() => ops.setPriority(job.id, null)}
        done={again}
      />
      {job.state === "paused" ? plain("Resume", "resume") : plain("Pause", "pause")}
      <ActionButton
        label="Cancel"
        danger
        confirmation={{
          title: `Cancel ${titleOf(job)}?`,
          text: "It stops within a second. Finished tasks are kept, so that it can be retried.",
        }}
        act={() => act(job.id, "cancel")}
        done={again}
      />
    </>
  );
}

export function LiveSessions({ sessions, again }: { sessions: LiveSession[]; again(): void }) {
  return (
    <Table<LiveSession>
      name="live"
      columns={["Session", "Frames", "Latency", "Dropped", ""]}
      empty="No live session is open."
      items={sessions}
      id={(session) => session.id}
      cells={(session) => [
        <SessionIdentity key="" session={session} />,
        `${session.figures.painted ?? 0} · ${session.figures.fps ?? 0} fps`,
        latency(session.figures.latency_ms),
        session.figures.dropped ?? 0,
        session.ending ? (
          "ending"
        ) : (
          <ActionButton
            label="End"
            danger
            confirmation={{
              title: "End this live session?",
              text: "Its client gets the message that an operator has ended it.",
            }}
            act={() => ops.endLive(session.id)}
            done={again}
          />
        ),
      ]}
    />
  );
}

function SessionIdentity({ session }: { session: LiveSession }) {
  const size = `${session.width} × ${session.height}`;
  return (
    <>
      <a href={under(`/live/view?session=${encodeURIComponent(session.id)}`)}>{session.method}</a>
      <small>{dotted(session.owner, size, ago(session.opened_at), !session.connected && "waits for its client")}</small>
    </>
  );
}

const latency = (ms: Record<string, number> | undefined): string =>
  ms ? `p50 ${ms.p50} · p95 ${ms.p95} · p99 ${ms.p99} ms` : "";

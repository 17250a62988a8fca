/** Workers (processes) and machines: their state, their tasks, and buttons to drain them. */

import { ActionButton } from "../ui/dialogs";
import { ago, percent } from "../ui/format";
import * as ops from "./api";
import { Badge, dotted, Table } from "./table";
import type { BoardCalls, Drain, NodeView, TaskRun, Worker } from "./types";

const DRAINED =
  "Its running tasks are finished, and no new task starts there until you resume it. Other workers take its tasks.";
const ROLES: Record<string, string> = { worker: "worker", serve: "service" };

export function Workers({ workers, again, onjob }: { workers: Worker[] } & BoardCalls) {
  return (
    <Table<Worker>
      name="workers"
      columns={["Worker", "State", "Slots", "Running", ""]}
      empty="No worker is here. Start one with `impasto worker`, or with `impasto serve`."
      items={workers}
      id={(worker) => worker.id}
      state={(worker) => worker.state}
      cells={(worker) => [
        <Identity key="" worker={worker} />,
        <Badge key="" state={worker.state}>
          {since(worker)}
        </Badge>,
        `${worker.at_work.length} / ${worker.slots.length}${worker.kind === "ray" ? " on Ray" : ""}`,
        worker.at_work.map((run) => <TaskLine key={run.attempt_id} run={run} onjob={onjob} />),
        (worker.drain || worker.state !== "away") && (
          <DrainButton kind="workers" name={worker.id} shown={worker.host} drain={worker.drain} again={again} />
        ),
      ]}
    />
  );
}

export function Nodes({ nodes, again }: { nodes: NodeView[]; again(): void }) {
  return (
    <Table<NodeView>
      name="machines"
      columns={["Machine", "State", "Slots", "Resources", ""]}
      empty="No machine offers a slot."
      items={nodes}
      id={(node) => node.name}
      state={(node) => node.state}
      cells={(node) => [
        node.name,
        <Badge key="" state={node.state}>
          {reasonOf(node.drain)}
        </Badge>,
        `${node.busy} / ${node.slots}`,
        resources(node),
        <DrainButton key="" kind="nodes" name={node.name} shown={node.name} drain={node.drain} again={again} />,
      ]}
    />
  );
}

interface DrainButtonProps {
  kind: ops.PlaceKind;
  name: string;
  shown: string;
  drain: Drain | null;
  again(): void;
}

function DrainButton({ kind, name, shown, drain, again }: DrainButtonProps) {
  if (drain) return <ActionButton key="resume" label="Resume" act={() => ops.resume(kind, name)} done={again} />;
  return (
    <ActionButton
      key="drain"
      label="Drain"
      confirmation={{ title: `Drain ${shown}?`, text: DRAINED, why: true }}
      act={(reason) => ops.drain(kind, name, reason)}
      done={again}
    />
  );
}

const reasonOf = (drain: Drain | null): string => (drain ? [drain.by, drain.reason].filter(Boolean).join(": ") : "");

function since(worker: Worker): string {
  if (worker.state === "away") return `silent since ${ago(worker.seen_at)}`;
  return reasonOf(worker.drain) || `since ${ago(worker.started_at)}`;
}

/** Host, role, version and short id; a worker that has just registered has no role yet. */
function Identity({ worker }: { worker: Worker }) {
  const version = worker.version && `version ${worker.version}`;
  return (
    <>
      <strong>{worker.host}</strong>
      <small>{dotted(ROLES[worker.role] ?? "starting", version, shortId(worker.id))}</small>
    </>
  );
}

/** The end of the id's random part, which distinguishes workers of a host. */
export const shortId = (id: string): string => (id.split("@")[0] ?? "").slice(-6);

function TaskLine({ run, onjob }: { run: TaskRun; onjob(id: string): void }) {
  return (
    <div class="work-line">
      <button type="button" class="link" onClick={() => onjob(run.job_id)}>
        {dotted(run.method, run.step, run.key)}
      </button>
      <small>
        {dotted(percent(run.progress), run.number > 1 && `attempt ${run.number}`, run.slot || "on its way")}
      </small>
    </div>
  );
}

function resources({ cpus, gpus, memory_bytes: memory }: NodeView): string {
  return [`${cpus} CPU`, gpus && `${gpus} GPU`, memory && `${(memory / 2 ** 30).toFixed(1)} GiB`]
    .filter(Boolean)
    .join(", ");
}

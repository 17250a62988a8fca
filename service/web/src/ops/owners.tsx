/** Users and groups with their quotas, who did what, costs, and rules that delete old jobs; read when they are opened. */

import type { ComponentChildren } from "preact";
import { useState } from "preact/hooks";
import { bodyOf, client } from "../api/client";
import type { Schemas } from "../api/schemas";
import { ActionButton } from "../ui/dialogs";
import { bytes, duration, moment } from "../ui/format";
import { notify } from "../ui/notices";
import { dotted, Table } from "./table";

type Owner = Schemas["Owner"];
type Entry = Schemas["AuditEntry"];
type Cost = Schemas["Cost"];
type Rule = Schemas["RuleOut"];
const QUOTAS = [
  "active_jobs",
  "asset_bytes",
  "document_bytes",
  "live_sessions",
  "requests_per_minute",
  "running_tasks",
] as const;

/** A part of the page whose content is read when it is opened; `show` gets it, and what reads it again. */
function Opened<Content>({
  id,
  title,
  read,
  show,
}: {
  id: string;
  title: string;
  read(): Promise<Content>;
  show(content: Content, again: () => void): ComponentChildren;
}) {
  const [content, setContent] = useState<Content | null>(null);
  const again = () => {
    read().then(setContent, notify);
  };
  return (
    <details class="part opened" id={id} onToggle={({ currentTarget }) => currentTarget.open && again()}>
      <summary>
        <h2>{title}</h2>
      </summary>
      {content === null ? <p class="placeholder">Loading…</p> : show(content, again)}
    </details>
  );
}

export function Owners() {
  const read = async () => (await bodyOf(client.GET("/v1/ops/owners"))).items;
  return (
    <Opened
      id="owners"
      title="Users and groups"
      read={read}
      show={(owners, again) => <OwnerTable {...{ owners, again }} />}
    />
  );
}

function OwnerTable({ owners, again }: { owners: Owner[]; again(): void }) {
  const create = (event: SubmitEvent) => {
    const form = submitted(event);
    const body = { kind: "group" as const, name: String(form.get("name")).trim() };
    return client.POST("/v1/ops/owners", { body }).catch(notify).then(again);
  };
  const change = (id: string, body: Schemas["OwnerPatch"]) =>
    client.PATCH("/v1/ops/owners/{owner_id}", { params: { path: { owner_id: id } }, body });
  const setQuota = (id: string) => (event: SubmitEvent) => {
    const form = submitted(event);
    const limit = String(form.get("limit")).trim();
    const quotas = { [String(form.get("quota"))]: limit === "" ? null : Number(limit) };
    return change(id, { quotas }).catch(notify).then(again);
  };
  return (
    <>
      <form class="row" onSubmit={create}>
        <input
          type="text"
          name="name"
          required
          maxLength={100}
          placeholder="Name of a group"
          aria-label="Name of a new group"
        />
        <button class="button small" type="submit">
          Create the group
        </button>
      </form>
      <Table<Owner>
        name="owners"
        columns={["Name", "Quotas", "Set a quota", ""]}
        items={owners}
        id={({ id }) => id}
        empty="Nobody has a key yet."
        state={({ disabled_at }) => (disabled_at ? "away" : "")}
        cells={(one) => [
          <>
            <strong>{one.name}</strong>
            <small>{dotted(one.kind, one.id, one.disabled_at && "disabled")}</small>
          </>,
          Object.entries(one.quotas).map(([name, limit]) => <small key={name}>{`${name} ${limit}`}</small>),
          <form class="row" key="quota" onSubmit={setQuota(one.id)}>
            <select name="quota" aria-label={`Quota of ${one.name}`}>
              {QUOTAS.map((name) => (
                <option key={name}>{name}</option>
              ))}
            </select>
            <input type="number" name="limit" min={0} placeholder="default" aria-label={`Limit for ${one.name}`} />
            <button class="button small" type="submit">
              Set
            </button>
          </form>,
          <ActionButton
            key="disable"
            label={one.disabled_at ? "Enable" : "Disable"}
            act={() => change(one.id, { disabled: !one.disabled_at })}
            done={again}
          />,
        ]}
      />
    </>
  );
}

/** Id -> name of users and groups. */
type Names = Map<string, string>;

async function readNames(): Promise<Names> {
  const { items } = await bodyOf(client.GET("/v1/ops/owners"));
  return new Map(items.map(({ id, name }) => [id, name]));
}

export function Audit() {
  const read = () =>
    Promise.all([bodyOf(client.GET("/v1/ops/audit", { params: { query: { limit: 100 } } })), readNames()]);
  const show = ([{ items }, names]: [{ items: Entry[] }, Names]) => (
    <Table<Entry>
      name="audit"
      columns={["When", "Who", "Object", "What"]}
      items={items}
      id={({ id }) => id}
      empty="Nothing has been done yet."
      cells={(one) => [
        moment(one.at),
        <>
          <strong>{names.get(one.user) ?? (one.user || "without a key")}</strong>
          <small>
            {dotted(one.owner !== one.user && one.owner && `for ${names.get(one.owner) ?? one.owner}`, one.address)}
          </small>
        </>,
        one.object,
        one.action,
      ]}
    />
  );
  return <Opened id="audit" title="Who did what" read={read} show={show} />;
}

export function Costs() {
  const [by, setBy] = useState("owner");
  const read = async (): Promise<[Cost[], Names]> => {
    const answer = await bodyOf(client.GET("/v1/ops/costs", { params: { query: { by } } }));
    return [(answer as { items: Cost[] }).items, await readNames()];
  };
  const show = ([costs, names]: [Cost[], Names], again: () => void) => (
    <>
      <form class="row" onSubmit={(event) => submitted(event) && again()}>
        <input
          type="text"
          value={by}
          required
          maxLength={80}
          aria-label="Sum by owner, or by the name of a label"
          onInput={({ currentTarget }) => setBy(currentTarget.value)}
        />
        <button class="button small" type="submit">
          Sum
        </button>
      </form>
      <Table<Cost>
        name="costs"
        columns={["Name", "Jobs", "CPU time", "Slot time", "Results"]}
        items={costs}
        id={({ name }) => name}
        empty="No job has ended yet."
        cells={(one) => [
          names.get(one.name) ?? (one.name || "none"),
          one.jobs,
          duration(one.cpu_s),
          duration(one.busy_s),
          bytes(one.bytes),
        ]}
      />
    </>
  );
  return <Opened id="costs" title="Costs" read={read} show={show} />;
}

export function Retention() {
  const read = async () => (await bodyOf(client.GET("/v1/ops/retention"))).items as Rule[];
  return (
    <Opened
      id="retention"
      title="Deletion by age"
      read={read}
      show={(rules, again) => <Rules {...{ rules, again }} />}
    />
  );
}

function Rules({ rules, again }: { rules: Rule[]; again(): void }) {
  const [trial, setTrial] = useState("");
  const send = async (event: SubmitEvent) => {
    const form = submitted(event);
    const text = (name: string) => String(form.get(name)).trim();
    const [label, ...value] = text("label").split(":");
    const body = {
      days: Number(form.get("days")),
      ...(text("owner") && { owner: text("owner") }),
      ...(label && { label, ...(value.length && { value: value.join(":") }) }),
    };
    const dry_run = (event.submitter as HTMLButtonElement).value === "try";
    const made = await bodyOf(client.POST("/v1/ops/retention", { body, params: { query: { dry_run } } })).catch(notify);
    if (made) setTrial(dry_run ? `It would delete ${made.due.jobs} jobs now.` : "");
    if (!dry_run) again();
  };
  return (
    <>
      <form class="row" onSubmit={send}>
        <input type="number" name="days" min={0} step="any" required placeholder="Days" aria-label="Age in days" />
        <input type="text" name="owner" placeholder="usr_… or grp_…" aria-label="Only of this owner" />
        <input type="text" name="label" placeholder="label:value" aria-label="Only with this label" />
        <button class="button small" type="submit" value="try">
          Try it
        </button>
        <button class="button small danger" type="submit" value="make">
          Make the rule
        </button>
        <span role="status">{trial}</span>
      </form>
      <Table<Rule>
        name="rules"
        columns={["Jobs that ended more than", "Only", "Due now", ""]}
        items={rules}
        id={({ rule }) => rule.id}
        empty="No rule: results stay until somebody deletes them."
        cells={({ rule, due }) => [
          `${rule.days} days ago`,
          dotted(rule.owner, rule.label && `${rule.label}${rule.value === null ? "" : `:${rule.value}`}`) || "all",
          due.jobs,
          <ActionButton
            key="delete"
            label="Delete the rule"
            act={() => client.DELETE("/v1/ops/retention/{rule_id}", { params: { path: { rule_id: rule.id } } })}
            done={again}
          />,
        ]}
      />
    </>
  );
}

/** The fields of a form that the page handles itself. */
function submitted(event: SubmitEvent): FormData {
  event.preventDefault();
  return new FormData(event.currentTarget as HTMLFormElement);
}

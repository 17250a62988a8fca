/** A form made from a JSON Schema: grouped, searchable, each value resettable; only changed values are sent. */

import type { ComponentChildren } from "preact";
import { useId, useMemo, useRef, useState } from "preact/hooks";
import type { Params, Schema } from "../api/schemas";
import { Icon } from "../ui/icons";
import { applies, type Situation } from "./applies";
import type { Ids } from "./control";
import { CONTROLS, INLINE, same } from "./fields";
import { keysOf } from "./keyed-values";
import { type FilmTime, OverTime, OverTimeButton } from "./over-time";
import { type Field, fieldsOf } from "./schema";

export interface FormProps {
  /** Of type object. */
  schema: Schema;
  /** The values that differ from the defaults. */
  values: Params;
  /** The values now; `valid`: whether all that the user typed can be parsed. What cannot be is left out of them. */
  onChange(values: Params, valid: boolean): void;
  /** How many groups start unfolded. */
  open?: number;
  /** Whether the form has a search box. */
  search?: boolean;
  /** Problems of the service, by name of the field. */
  faults?: Record<string, string>;
  /** Hides the fields that have no effect in it, unless they were changed. */
  situation?: Situation;
  /** The film's time, if numbers can be set over it. */
  time?: FilmTime;
}

export function Form(props: FormProps) {
  const { schema, values, onChange, open = 1, search = false, faults = {}, situation = {}, time } = props;
  const fields = useMemo(() => fieldsOf(schema), [schema]);
  const emitted = useRef(values);
  const epoch = useRef(0);
  const [wrong, setWrong] = useState<Record<string, string>>({});
  const [words, setWords] = useState("");
  if (values !== emitted.current) {
    emitted.current = values;
    epoch.current += 1;
    if (Object.keys(wrong).length) setWrong({});
  }

  function change(field: Field, value: unknown): void {
    const { [field.name]: _old, ...rest } = values;
    const { [field.name]: _mended, ...others } = wrong;
    const next = same(value, field.initial) ? rest : { ...rest, [field.name]: value };
    emitted.current = next;
    setWrong(others);
    onChange(next, !Object.keys(others).length);
  }

  function refuse(field: Field, why: string): void {
    setWrong({ ...wrong, [field.name]: why });
    onChange(values, false);
  }

  const all = { ...Object.fromEntries(fields.map(({ name, initial }) => [name, initial])), ...values };
  const idle = (field: Field) => !applies(field.appliesWhen, all, situation);
  const fits = (field: Field) =>
    `${field.title} ${field.name} ${field.help}`.toLowerCase().includes(words) &&
    (!idle(field) || field.name in values);
  return (
    <div class="form">
      {search && (
        <div class="form-search">
          <input
            type="search"
            placeholder="Search all settings"
            aria-label="Search all settings"
            onInput={(event) => setWords(event.currentTarget.value.trim().toLowerCase())}
          />
          <p class="field-help" role="status">
            {!fields.some(fits) && "No setting has that word."}
          </p>
        </div>
      )}
      {grouped(fields).map(([title, members], i) => {
        const found = members.some(fits);
        const broken = members.some(({ name }) => wrong[name] || faults[name]);
        return (
          <Group
            key={title}
            title={title}
            hidden={!found}
            open={broken || (words ? found : i < open)}
            changed={members.filter(({ name }) => name in values).length}
          >
            {members.map((field) => (
              <Row
                key={field.name}
                field={field}
                value={field.name in values ? values[field.name] : field.initial}
                changed={field.name in values}
                idle={idle(field)}
                epoch={epoch.current}
                fault={wrong[field.name] ?? faults[field.name] ?? ""}
                hidden={!fits(field)}
                time={time}
                onChange={(value) => change(field, value)}
                onFault={(why) => refuse(field, why)}
                onReset={() => {
                  epoch.current += 1;
                  change(field, field.initial);
                }}
              />
            ))}
          </Group>
        );
      })}
    </div>
  );
}

/** Whether the form of a schema has a field of this name. */
export const hasField = (schema: Schema, name: string): boolean => name in (schema.properties ?? {});

/** Fields by group, groups in order of appearance. */
function grouped(fields: Field[]): [string, Field[]][] {
  const found = new Map<string, Field[]>();
  for (const field of fields) found.set(field.group, [...(found.get(field.group) ?? []), field]);
  return [...found];
}

interface GroupProps {
  title: string;
  hidden: boolean;
  open: boolean;
  /** How many fields have another value than their default. */
  changed: number;
  children: ComponentChildren;
}

function Group({ title, hidden, open, changed, children }: GroupProps) {
  const body = (
    <div class="group-body" hidden={!title && hidden}>
      {children}
    </div>
  );
  if (!title) return body;
  return (
    <details class="group" open={open} hidden={hidden}>
      <summary>
        <span>{title}</span>
        <span class="count">{changed ? `${changed} changed` : ""}</span>
      </summary>
      {body}
    </details>
  );
}

interface RowProps {
  field: Field;
  value: unknown;
  changed: boolean;
  /** Whether the value has no effect now. */
  idle: boolean;
  epoch: number;
  fault: string;
  hidden: boolean;
  time: FilmTime | undefined;
  onChange(value: unknown): void;
  onFault(why: string): void;
  onReset(): void;
}

function Row({ field, value, changed, idle, epoch, fault, hidden, time, onChange, onFault, onReset }: RowProps) {
  const id = useId();
  const row = useRef<HTMLDivElement>(null);
  const ids: Ids = { input: `${id}-input`, label: `${id}-label`, help: `${id}-help`, error: `${id}-error` };
  const keys = field.varies ? keysOf(value) : undefined;
  const Control = CONTROLS[keys && !time ? "json" : field.kind];
  const given = { field, ids, value, epoch, wrong: Boolean(fault), onChange, onFault };
  const reset = () => {
    onReset();
    const inputs = "input, select, textarea";
    const first =
      row.current?.querySelector<HTMLElement>("input:checked") ?? row.current?.querySelector<HTMLElement>(inputs);
    first?.focus();
  };
  return (
    <div
      ref={row}
      class={`field ${INLINE.includes(field.kind) ? "field-inline" : ""} ${fault ? "wrong" : ""}`}
      hidden={hidden}
    >
      <div class="field-head">
        <label id={ids.label} for={ids.input}>
          {field.title}
          {field.symbol && <PaperSymbol text={field.symbol} />}
        </label>
        <button
          type="button"
          class="reset"
          hidden={!changed && !fault}
          aria-label={`Reset ${field.title}`}
          title="Reset to default"
          onClick={reset}
        >
          <Icon name="retry" />
        </button>
        {field.varies && time && <OverTimeButton {...given} time={time} />}
        {field.unit && field.unit !== "ratio" && <span class="unit">{unitWord(field.unit)}</span>}
      </div>
      {keys && time ? <OverTime {...given} keys={keys} time={time} Slider={Control} /> : <Control {...given} />}
      <p class="field-help" id={ids.help}>
        {idle && "Without effect at present. "}
        {field.help}
      </p>
      <p class="field-error" id={ids.error}>
        {fault}
      </p>
    </div>
  );
}

const unitWord = (unit: string): string =>
  unit.replace("per mille of the", "‰ of").replace("per mille", "‰").replace("degrees", "°");

const GREEK: Record<string, string> = {
  alpha: "α",
  beta: "β",
  gamma: "γ",
  delta: "δ",
  epsilon: "ε",
  lambda: "λ",
  mu: "μ",
  phi: "φ",
  rho: "ρ",
  sigma: "σ",
  tau: "τ",
};

/** The paper's symbol in its letters, its subscript lowered: "sigma_e". */
function PaperSymbol({ text }: { text: string }) {
  const [base = "", ...below] = text.split("_").map((part) => GREEK[part] ?? part);
  return (
    <i class="symbol" title="Symbol in the paper">
      {base}
      {below.length > 0 && <sub>{below.join("").replace(/[{}]/g, "")}</sub>}
    </i>
  );
}

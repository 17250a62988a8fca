/** A form made from a JSON Schema: grouped, searchable, each value resettable; only changed values are sent. */

import type { Params, Schema } from "../api/schemas";
import { type Child, h, unique } from "../ui/dom";
import { icon } from "../ui/icons";
import { type Control, control, type Ids } from "./fields";
import { type Field, fieldsOf } from "./schema";

/** Equal as the form shows them: numbers to four digits. */
const same = (a: unknown, b: unknown): boolean => rounded(a) === rounded(b);
const rounded = (value: unknown): string | undefined =>
  JSON.stringify(value, (_, v) => (typeof v === "number" ? Number(v.toPrecision(4)) : v));

export interface FormOptions {
  onchange(): void;
  /** How many groups start unfolded. */
  open?: number;
  /** Whether the form has a search box. */
  search?: boolean;
}

export interface Form {
  element: HTMLElement;
  /** The changed values. */
  values(): Params;
  /** Whether every value can be parsed. */
  valid(): boolean;
  /** Set the given values, and all others to their defaults. */
  write(values: Params): void;
  /** Show a problem beside the field of that name; false if there is no such field. */
  problem(name: string, text: string): boolean;
  /** Remove all problems. */
  quiet(): void;
}

/** `schema` is of type object. */
export function createForm(schema: Schema, { onchange, open = 1, search = false }: FormOptions): Form {
  const rows: Row[] = fieldsOf(schema).map((field) => createRow(field, changed));
  const groups = grouped(rows).map(([title, members], i) => createGroup(title, members, i < open));

  function changed(): void {
    for (const group of groups) group.refresh();
    onchange();
  }

  function write(values: Params): void {
    for (const row of rows) row.write(row.field.name in values ? values[row.field.name] : row.field.initial);
    for (const group of groups) group.refresh();
  }

  write({});
  const box = search ? searchBox(groups) : null;
  return {
    element: h(
      "div",
      { class: "form" },
      box,
      groups.map((group) => group.element),
    ),
    values: () =>
      Object.fromEntries(rows.filter((row) => row.changed()).map((row) => [row.field.name, row.value() ?? null])),
    valid: () => rows.every((row) => row.valid()),
    write,
    problem: (name, text) => complain(rows, groups, name, text),
    quiet() {
      for (const row of rows) row.complain("");
    },
  };
}

/** Rows by group, groups in order of appearance. */
function grouped(rows: Row[]): [string, Row[]][] {
  const found = new Map<string, Row[]>();
  for (const row of rows) found.set(row.field.group, [...(found.get(row.field.group) ?? []), row]);
  return [...found];
}

function complain(rows: Row[], groups: Group[], name: string, text: string): boolean {
  const row = rows.find((candidate) => candidate.field.name === name);
  if (!row) return false;
  row.complain(text);
  groups.find((group) => group.rows.includes(row))?.unfold();
  return true;
}

/** A box that hides every setting whose name and help do not contain the text. */
function searchBox(groups: Group[]): HTMLElement {
  const none = h("p", { class: "field-help", role: "status" });
  const find = () => {
    const words = box.value.trim().toLowerCase();
    const found = groups.reduce((sum, group) => sum + group.filter(words), 0);
    none.textContent = found ? "" : "No setting has that word.";
  };
  const box = h("input", {
    type: "search",
    placeholder: "Search all settings",
    "aria-label": "Search all settings",
    oninput: find,
  });
  return h("div", { class: "form-search" }, box, none);
}

interface Group {
  element: HTMLElement;
  rows: Row[];
  refresh(): void;
  unfold(): void;
  /** Show the rows that match; returns how many. */
  filter(words: string): number;
}

function createGroup(title: string, rows: Row[], open: boolean): Group {
  const count = h("span", { class: "count" });
  const body = h(
    "div",
    { class: "group-body" },
    rows.map((row) => row.element),
  );
  const details = title
    ? h("details", { class: "group", open }, h("summary", {}, h("span", {}, title), count), body)
    : null;
  return {
    element: details ?? body,
    rows,
    refresh() {
      const changed = rows.filter((row) => row.changed()).length;
      count.textContent = changed ? `${changed} changed` : "";
    },
    unfold() {
      if (details) details.open = true;
    },
    filter(words) {
      let found = 0;
      for (const row of rows) {
        const fits = `${row.field.title} ${row.field.name} ${row.field.help}`.toLowerCase().includes(words);
        row.element.hidden = !fits;
        if (fits) found += 1;
      }
      (details ?? body).hidden = !found;
      if (details) details.open = words ? found > 0 : open;
      return found;
    },
  };
}

interface Row {
  field: Field;
  element: HTMLElement;
  /** undefined while the text cannot be parsed. */
  value(): unknown | undefined;
  write(given: unknown | undefined): void;
  complain(text: string): void;
  changed(): boolean;
  valid(): boolean;
}

function createRow(field: Field, changed: () => void): Row {
  const ids: Ids = { input: unique("field"), label: unique("label"), help: unique("help"), error: unique("error") };
  const part: Control = control(field, ids, () => {
    refresh();
    changed();
  });
  const error = h("p", { class: "field-error", id: ids.error });
  const reset = h("button", { type: "button", class: "reset", hidden: true, onclick: () => revert() }, icon("retry"));
  reset.setAttribute("aria-label", `Reset ${field.title}`);
  reset.title = "Reset to default";
  const help = h("p", { class: "field-help", id: ids.help }, field.help);
  const element = h(
    "div",
    { class: `field ${part.inline ? "field-inline" : ""}` },
    head(field, ids, reset),
    part.element,
    help,
    error,
  );

  function value(): unknown | undefined {
    try {
      return part.read();
    } catch {
      return undefined;
    }
  }

  const altered = () => value() !== undefined && !same(value(), field.initial);

  function complain(text: string): void {
    error.textContent = text;
    element.classList.toggle("wrong", Boolean(text));
    for (const input of element.querySelectorAll("input, select, textarea")) {
      input.setAttribute("aria-invalid", String(Boolean(text)));
    }
  }

  /** Report a value that cannot be parsed at once; remove the service's message about the previous value. */
  function refresh(): void {
    reset.hidden = value() !== undefined && !altered();
    try {
      part.read();
      complain("");
    } catch (fault) {
      complain(fault instanceof Error ? fault.message : String(fault));
    }
  }

  function write(given: unknown | undefined): void {
    part.write(given);
    refresh();
  }

  function revert(): void {
    write(field.initial);
    (
      element.querySelector<HTMLElement>("input:checked") ??
      element.querySelector<HTMLElement>("input, select, textarea")
    )?.focus();
    changed();
  }

  return { field, element, value, write, complain, changed: altered, valid: () => value() !== undefined };
}

function head(field: Field, ids: Ids, reset: HTMLElement): HTMLElement {
  const label = h("label", { id: ids.label, for: ids.input }, field.title, field.symbol && symbol(field.symbol));
  const unit = field.unit && field.unit !== "ratio" && h("span", { class: "unit" }, unitWord(field.unit));
  return h("div", { class: "field-head" }, label, reset, unit);
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
function symbol(text: string): Child {
  const [base = "", ...below] = text.split("_").map((part) => GREEK[part] ?? part);
  const subscript = below.length > 0 && h("sub", {}, below.join("").replace(/[{}]/g, ""));
  return h("i", { class: "symbol", title: "Symbol in the paper" }, base, subscript);
}

/** A form made from a JSON Schema: grouped, each value resettable, only what was changed is sent. */

import { control } from "./fields.js";
import { h, icon, unique } from "./dom.js";
import { fieldsOf } from "./schema.js";

/** Equal as the form shows them: numbers to four digits. */
const same = (a, b) => shown(a) === shown(b);
const shown = (value) => JSON.stringify(value, (_, v) => (typeof v === "number" ? Number(v.toPrecision(4)) : v));

/**
 * @param {object} schema of type object
 * @param {{onchange: Function, open?: number}} options `open`: how many groups start unfolded
 * @returns {{element, values(): object, valid(): boolean, write(values), problem(name, text): boolean, quiet()}}
 */
export function createForm(schema, { onchange, open = 1 }) {
  const rows = fieldsOf(schema).map((field) => createRow(field, changed));
  const groups = grouped(rows).map(([title, members], i) => createGroup(title, members, i < open));

  function changed() {
    groups.forEach((group) => group.refresh());
    onchange();
  }

  function write(values) {
    rows.forEach((row) => row.write(row.field.name in values ? values[row.field.name] : row.field.initial));
    groups.forEach((group) => group.refresh());
  }

  write({});
  return {
    element: h("div", { class: "form" }, groups.map((group) => group.element)),
    values: () => Object.fromEntries(rows.filter((row) => row.changed()).map((row) => [row.field.name, row.value()])),
    valid: () => rows.every((row) => row.valid()),
    write,
    problem: (name, text) => complain(rows, groups, name, text),
    quiet: () => rows.forEach((row) => row.complain("")),
  };
}

/** Rows by group, groups in order of appearance. */
function grouped(rows) {
  const found = new Map();
  for (const row of rows) found.set(row.field.group, [...(found.get(row.field.group) ?? []), row]);
  return [...found];
}

function complain(rows, groups, name, text) {
  const row = rows.find((candidate) => candidate.field.name === name);
  if (!row) return false;
  row.complain(text);
  groups.find((group) => group.rows.includes(row)).unfold();
  return true;
}

function createGroup(title, rows, open) {
  const count = h("span", { class: "count" });
  const body = h("div", { class: "group-body" }, rows.map((row) => row.element));
  const element = title ? h("details", { class: "group", open }, h("summary", {}, h("span", {}, title), count), body) : body;
  const refresh = () => {
    const changed = rows.filter((row) => row.changed()).length;
    count.textContent = changed ? `${changed} changed` : "";
  };
  return { element, rows, refresh, unfold: () => (element.open = true) };
}

function createRow(field, changed) {
  const ids = { input: unique("field"), label: unique("label"), help: unique("help"), error: unique("error") };
  const part = control(field, ids, () => refresh() || changed());
  const error = h("p", { class: "field-error", id: ids.error });
  const reset = h("button", { type: "button", class: "reset", hidden: true, onclick: () => revert() }, icon("retry"));
  reset.setAttribute("aria-label", `Reset ${field.title}`);
  reset.title = "Reset to default";
  const element = h("div", { class: `field ${part.inline ? "field-inline" : ""}` }, head(field, ids, reset), part.element, help(field, ids), error);

  const value = () => {
    try {
      return part.read();
    } catch {
      return undefined;
    }
  };
  const altered = () => value() !== undefined && !same(value(), field.initial);

  function complain(text) {
    error.textContent = text;
    element.classList.toggle("wrong", Boolean(text));
    element.querySelectorAll("input, select, textarea").forEach((input) => input.setAttribute("aria-invalid", String(Boolean(text))));
  }

  /** Show what cannot be parsed at once; forget what the service said of the old value. */
  function refresh() {
    reset.hidden = value() !== undefined && !altered();
    try {
      part.read();
      complain("");
    } catch (fault) {
      complain(fault.message);
    }
  }

  function write(given) {
    part.write(given);
    refresh();
  }

  function revert() {
    write(field.initial);
    (element.querySelector("input:checked") ?? element.querySelector("input, select, textarea")).focus();
    changed();
  }

  return { field, element, value, write, complain, changed: altered, valid: () => value() !== undefined };
}

function head(field, ids, reset) {
  const label = h("label", { id: ids.label, for: ids.input }, field.title, field.symbol && symbol(field.symbol));
  const unit = field.unit && field.unit !== "ratio" && h("span", { class: "unit" }, unitWord(field.unit));
  return h("div", { class: "field-head" }, label, reset, unit);
}

const unitWord = (unit) => unit.replace("per mille of the", "‰ of").replace("per mille", "‰").replace("degrees", "°");

const GREEK = { alpha: "α", beta: "β", gamma: "γ", delta: "δ", epsilon: "ε", lambda: "λ", mu: "μ", phi: "φ", rho: "ρ", sigma: "σ", tau: "τ" };

/** The paper's symbol in its letters, its subscript lowered: "sigma_e". */
function symbol(text) {
  const [base, ...below] = text.split("_").map((part) => GREEK[part] ?? part);
  return h("i", { class: "symbol", title: "Symbol in the paper" }, base, below.length > 0 && h("sub", {}, below.join("").replace(/[{}]/g, "")));
}

const help = (field, ids) => h("p", { class: "field-help", id: ids.help }, field.help);

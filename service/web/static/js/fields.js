/** One form control a kind of field. Each is {element, read(), write(value), label}: read throws on what it cannot parse. */

import { h, unique } from "./dom.js";
import { snap } from "./schema.js";

/** The control of a field; `changed` is called whenever the user alters it. `ids` are those of label, help and error. */
export function control(field, ids, changed) {
  return KINDS[field.kind](field, ids, changed);
}

const described = (ids) => ({ "aria-describedby": `${ids.help} ${ids.error}` });

function slider(field, ids, changed) {
  const span = field.max - field.min;
  const track = h("input", { type: "range", min: "0", max: "1", step: "any", "aria-labelledby": ids.label, ...described(ids) });
  const box = numberBox(field, ids);
  const place = () => {
    const share = Math.min(1, Math.max(0, (box.value - field.min) / span));
    track.value = String(share ** (1 / field.curve));
    paint();
  };
  const paint = () => {
    track.style.setProperty("--fill", track.value);
    track.setAttribute("aria-valuetext", `${box.value} ${field.unit}`.trim());
  };
  track.addEventListener("input", () => {
    box.value = snap(field.min + span * track.value ** field.curve, field);
    paint();
    changed();
  });
  box.addEventListener("input", () => (place(), changed()));
  const write = (value) => ((box.value = round(value)), place());
  return { element: h("div", { class: "slider" }, track, box), read: () => number(box.value, field), write };
}

/** A default such as two thirds, as it is read. */
const round = (value) => Number(Number(value).toPrecision(4));

const strings = (object) => Object.fromEntries(Object.entries(object).map(([name, value]) => [name, String(value)]));

function numberBox(field, ids) {
  const limits = strings(Object.fromEntries(["min", "max"].filter((k) => field[k] !== undefined).map((k) => [k, field[k]])));
  return h("input", { type: "number", id: ids.input, step: field.whole ? "1" : "any", inputmode: field.whole ? "numeric" : "decimal", ...limits, ...described(ids) });
}

function number(text, field) {
  if (text === "" && field.nullable) return null;
  if (text === "" || Number.isNaN(Number(text))) throw new Error("Enter a number.");
  const value = Number(text);
  if (value < field.min || value > field.max) throw new Error(`Enter a number from ${field.min} to ${field.max}.`);
  if (field.whole && !Number.isInteger(value)) throw new Error("Enter a whole number.");
  return value;
}

function plainNumber(field, ids, changed) {
  const box = numberBox(field, ids);
  box.addEventListener("input", changed);
  if (field.nullable) box.placeholder = "auto";
  return { element: box, read: () => number(box.value, field), write: (value) => (box.value = value ?? "") };
}

function toggle(field, ids, changed) {
  const box = h("input", { type: "checkbox", role: "switch", id: ids.input, onchange: changed, ...described(ids) });
  return { element: box, read: () => box.checked, write: (value) => (box.checked = Boolean(value)), inline: true };
}

function onoff(field, ids, changed) {
  const { element, read, write, inline } = toggle(field, ids, changed);
  return { element, inline, read: () => (read() ? "on" : "off"), write: (value) => write(value === "on") };
}

function choice(field, ids, changed) {
  const short = field.options.length <= 3 && field.options.reduce((sum, o) => sum + o.title.length, 0) <= 28;
  return short && !field.nullable ? segments(field, ids, changed) : select(field, ids, changed);
}

function select(field, ids, changed) {
  const options = field.options.map((option, i) => h("option", { value: String(i) }, option.title));
  const none = field.nullable && h("option", { value: "" }, "Automatic");
  const element = h("select", { id: ids.input, onchange: changed, ...described(ids) }, none, options);
  const index = (value) => field.options.findIndex((option) => option.value === value);
  const write = (value) => (element.value = value === null ? "" : String(index(value)));
  return { element, write, read: () => (element.value === "" ? null : field.options[Number(element.value)].value) };
}

function segments(field, ids, changed) {
  const name = unique("choice");
  const boxes = field.options.map(() => h("input", { type: "radio", name, onchange: changed }));
  const items = field.options.map((option, i) => h("label", { class: "segment" }, boxes[i], h("span", {}, option.title)));
  return {
    element: h("div", { class: "segments", role: "radiogroup", "aria-labelledby": ids.label, ...described(ids) }, items),
    read: () => field.options[boxes.findIndex((box) => box.checked)]?.value,
    write: (value) => boxes.forEach((box, i) => (box.checked = field.options[i].value === value)),
  };
}

function choices(field, ids, changed) {
  const boxes = field.options.map(() => h("input", { type: "checkbox", onchange: changed }));
  const items = field.options.map((option, i) => h("label", { class: "chip" }, boxes[i], h("span", {}, option.title)));
  return {
    element: h("div", { class: "chips", role: "group", "aria-labelledby": ids.label, ...described(ids) }, items),
    read: () => field.options.filter((_, i) => boxes[i].checked).map((option) => option.value),
    write: (value) => boxes.forEach((box, i) => (box.checked = (value ?? []).includes(field.options[i].value))),
  };
}

function text(field, ids, changed) {
  const box = h("input", { type: "text", id: ids.input, oninput: changed, autocomplete: "off", ...described(ids) });
  return { element: box, read: () => (box.value === "" && field.nullable ? null : box.value), write: (value) => (box.value = value ?? "") };
}

function json(field, ids, changed) {
  const box = h("textarea", { id: ids.input, rows: 2, spellcheck: "false", oninput: changed, ...described(ids) });
  return { element: box, read: () => parsed(box.value), write: (value) => (box.value = value === null || value === undefined ? "" : JSON.stringify(value)) };
}

function parsed(value) {
  if (value.trim() === "") return null;
  try {
    return JSON.parse(value);
  } catch {
    throw new Error("Enter JSON, for example [0.2, 0.5, 0.3].");
  }
}

const KINDS = { slider, number: plainNumber, switch: toggle, onoff, choice, choices, text, json };

/** One form control for each kind of field. */

import { h, type Props, unique } from "../ui/dom";
import { type Field, type FieldKind, snap } from "./schema";

export interface Control {
  element: HTMLElement;
  /** The value; throws an Error with a message for the user if the text cannot be parsed. */
  read(): unknown | undefined;
  write(value: unknown | undefined): void;
  /** Whether the control stands beside its label instead of below it. */
  inline?: boolean;
}

/** Element ids that tie label, help and error to the input. */
export interface Ids {
  input: string;
  label: string;
  help: string;
  error: string;
}

type MakeControl = (field: Field, ids: Ids, changed: () => void) => Control;

/** The control of a field; `changed` is called whenever the user alters it. */
export const control: MakeControl = (field, ids, changed) => KINDS[field.kind](field, ids, changed);

const described = (ids: Ids): Props => ({ "aria-describedby": `${ids.help} ${ids.error}` });

const slider: MakeControl = (field, ids, changed) => {
  const min = field.min ?? 0;
  const span = (field.max ?? 1) - min;
  const track = h("input", {
    type: "range",
    min: "0",
    max: "1",
    step: "any",
    "aria-labelledby": ids.label,
    ...described(ids),
  });
  const box = numberBox(field, ids);
  const paint = () => {
    track.style.setProperty("--fill", track.value);
    track.setAttribute("aria-valuetext", `${box.value} ${field.unit}`.trim());
  };
  const place = () => {
    const share = Math.min(1, Math.max(0, (Number(box.value) - min) / span));
    track.value = String(share ** (1 / field.curve));
    paint();
  };
  track.addEventListener("input", () => {
    box.value = String(snap(min + span * Number(track.value) ** field.curve, field));
    paint();
    changed();
  });
  box.addEventListener("input", () => {
    place();
    changed();
  });
  const write = (value: unknown | undefined) => {
    box.value = String(round(Number(value)));
    place();
  };
  return { element: h("div", { class: "slider" }, track, box), read: () => parseNumber(box.value, field), write };
};

/** A default such as two thirds, with four digits. */
const round = (value: number): number => Number(value.toPrecision(4));

function numberBox(field: Field, ids: Ids): HTMLInputElement {
  const limits: Props = {};
  if (field.min !== undefined) limits.min = String(field.min);
  if (field.max !== undefined) limits.max = String(field.max);
  const step = field.whole ? "1" : "any";
  const inputmode = field.whole ? "numeric" : "decimal";
  return h("input", { type: "number", id: ids.input, step, inputmode, ...limits, ...described(ids) });
}

function parseNumber(text: string, field: Field): number | null {
  if (text === "" && field.nullable) return null;
  const value = Number(text);
  if (text === "" || Number.isNaN(value)) throw new Error("Enter a number.");
  const { min = -Infinity, max = Infinity } = field;
  if (value < min || value > max) throw new Error(`Enter a number from ${field.min} to ${field.max}.`);
  if (field.whole && !Number.isInteger(value)) throw new Error("Enter a whole number.");
  return value;
}

const plainNumber: MakeControl = (field, ids, changed) => {
  const box = numberBox(field, ids);
  box.addEventListener("input", changed);
  if (field.nullable) box.placeholder = "auto";
  const write = (value: unknown | undefined) => {
    box.value = value === null || value === undefined ? "" : String(value);
  };
  return { element: box, read: () => parseNumber(box.value, field), write };
};

function checkbox(ids: Ids, changed: () => void): HTMLInputElement {
  return h("input", { type: "checkbox", role: "switch", id: ids.input, onchange: changed, ...described(ids) });
}

const toggle: MakeControl = (_field, ids, changed) => {
  const box = checkbox(ids, changed);
  const write = (value: unknown | undefined) => {
    box.checked = Boolean(value);
  };
  return { element: box, inline: true, read: () => box.checked, write };
};

const onOff: MakeControl = (_field, ids, changed) => {
  const box = checkbox(ids, changed);
  const write = (value: unknown | undefined) => {
    box.checked = value === "on";
  };
  return { element: box, inline: true, read: () => (box.checked ? "on" : "off"), write };
};

const choice: MakeControl = (field, ids, changed) => {
  const characters = field.options.reduce((sum, option) => sum + option.title.length, 0);
  const short = field.options.length <= 4 && characters <= 28;
  return short && !field.nullable ? segments(field, ids, changed) : select(field, ids, changed);
};

const select: MakeControl = (field, ids, changed) => {
  const options = field.options.map((option, i) => h("option", { value: String(i) }, option.title));
  const none = field.nullable && h("option", { value: "" }, "Automatic");
  const element = h("select", { id: ids.input, onchange: changed, ...described(ids) }, none, options);
  const write = (value: unknown | undefined) => {
    const index = field.options.findIndex((option) => option.value === value);
    element.value = value === null ? "" : String(index);
  };
  return { element, write, read: () => (element.value === "" ? null : field.options[Number(element.value)]?.value) };
};

const segments: MakeControl = (field, ids, changed) => {
  const name = unique("choice");
  const boxes = field.options.map(() => h("input", { type: "radio", name, onchange: changed }));
  const items = field.options.map((option, i) =>
    h("label", { class: "segment" }, boxes[i], h("span", {}, option.title)),
  );
  return {
    element: h(
      "div",
      { class: "segments", role: "radiogroup", "aria-labelledby": ids.label, ...described(ids) },
      items,
    ),
    read: () => field.options[boxes.findIndex((box) => box.checked)]?.value,
    write(value) {
      boxes.forEach((box, i) => {
        box.checked = field.options[i]?.value === value;
      });
    },
  };
};

const choices: MakeControl = (field, ids, changed) => {
  const boxes = field.options.map(() => h("input", { type: "checkbox", onchange: changed }));
  const items = field.options.map((option, i) => h("label", { class: "chip" }, boxes[i], h("span", {}, option.title)));
  return {
    element: h("div", { class: "chips", role: "group", "aria-labelledby": ids.label, ...described(ids) }, items),
    read: () => field.options.filter((_, i) => boxes[i]?.checked).map((option) => option.value),
    write(value) {
      const chosen = Array.isArray(value) ? value : [];
      boxes.forEach((box, i) => {
        box.checked = chosen.includes(field.options[i]?.value ?? null);
      });
    },
  };
};

const text: MakeControl = (field, ids, changed) => {
  const box = h("input", { type: "text", id: ids.input, oninput: changed, autocomplete: "off", ...described(ids) });
  const write = (value: unknown | undefined) => {
    box.value = typeof value === "string" ? value : "";
  };
  return { element: box, read: () => (box.value === "" && field.nullable ? null : box.value), write };
};

const json: MakeControl = (_field, ids, changed) => {
  const box = h("textarea", { id: ids.input, rows: 2, spellcheck: "false", oninput: changed, ...described(ids) });
  const write = (value: unknown | undefined) => {
    box.value = value === null || value === undefined ? "" : JSON.stringify(value);
  };
  return { element: box, read: () => parseJson(box.value), write };
};

function parseJson(value: string): unknown {
  if (value.trim() === "") return null;
  try {
    return JSON.parse(value);
  } catch {
    throw new Error("Enter JSON, for example [0.2, 0.5, 0.3].");
  }
}

const KINDS: Record<FieldKind, MakeControl> = {
  slider,
  number: plainNumber,
  switch: toggle,
  onoff: onOff,
  choice,
  choices,
  text,
  json,
};

/** One form control for each kind of field. */

import { useState } from "preact/hooks";
import { ColourBox, ColourList } from "./colour-fields";
import { type Control, type ControlProps, described } from "./control";
import { type Field, type FieldKind, snap } from "./schema";

/** Equal as the form shows them: numbers to four digits. */
export const same = (a: unknown, b: unknown): boolean => rounded(a) === rounded(b);
const rounded = (value: unknown): string | undefined =>
  JSON.stringify(value, (_, v) => (typeof v === "number" ? Number(v.toPrecision(4)) : v));

/** What a text box shows: what the user has typed while that is the present value or none, else the value. */
function useText(props: ControlProps, format: (value: unknown) => string, parse: (text: string) => unknown) {
  const { value, epoch, onChange, onFault } = props;
  const [typed, setTyped] = useState<{ text: string; epoch: number; value?: unknown } | null>(null);
  const counts = typed?.epoch === epoch && (!("value" in typed) || same(typed.value, value));
  const type = (text: string) => {
    try {
      const parsed = parse(text);
      setTyped({ text, epoch, value: parsed });
      onChange(parsed);
    } catch (fault) {
      setTyped({ text, epoch });
      onFault(fault instanceof Error ? fault.message : String(fault));
    }
  };
  return { text: counts && typed ? typed.text : format(value), type };
}

const NumberBox: Control = (props) => {
  const { field, ids } = props;
  const { text, type } = useText(props, numberText, (typed) => parseNumber(typed, field));
  return (
    <input
      type="number"
      id={ids.input}
      min={field.min}
      max={field.max}
      step={field.whole ? "1" : "any"}
      inputMode={field.whole ? "numeric" : "decimal"}
      placeholder={field.nullable ? "auto" : ""}
      value={text}
      onInput={(event) => type(event.currentTarget.value)}
      {...described(props)}
    />
  );
};

/** A default such as two thirds, with four digits. */
const numberText = (value: unknown): string =>
  value === null || value === undefined ? "" : String(Number(Number(value).toPrecision(4)));

function parseNumber(text: string, field: Field): number | null {
  if (text === "" && field.nullable) return null;
  const value = Number(text);
  if (text === "" || Number.isNaN(value)) throw new Error("Enter a number.");
  const { min = -Infinity, max = Infinity } = field;
  if (value < min || value > max) throw new Error(`Enter a number from ${field.min} to ${field.max}.`);
  if (field.whole && !Number.isInteger(value)) throw new Error("Enter a whole number.");
  return value;
}

const Slider: Control = (props) => {
  const { field, ids, value, onChange } = props;
  const min = field.min ?? 0;
  const span = (field.max ?? 1) - min;
  const share = Math.min(1, Math.max(0, (Number(value) - min) / span)) ** (1 / field.curve);
  return (
    <div class="slider">
      <input
        type="range"
        min="0"
        max="1"
        step="any"
        aria-labelledby={ids.label}
        aria-valuetext={`${numberText(value)} ${field.unit}`.trim()}
        style={{ "--fill": share }}
        value={share}
        onInput={(event) => onChange(snap(min + span * Number(event.currentTarget.value) ** field.curve, field))}
        {...described(props)}
      />
      <NumberBox {...props} />
    </div>
  );
};

/** A switch between two values. */
const switchOf =
  (on: unknown, off: unknown): Control =>
  (props) => (
    <input
      type="checkbox"
      role="switch"
      id={props.ids.input}
      checked={props.value === on}
      aria-checked={props.value === on}
      onChange={(event) => props.onChange(event.currentTarget.checked ? on : off)}
      {...described(props)}
    />
  );

const Choice: Control = (props) => {
  const { options, nullable } = props.field;
  const characters = options.reduce((sum, option) => sum + option.title.length, 0);
  return options.length <= 4 && characters <= 28 && !nullable ? <Segments {...props} /> : <Select {...props} />;
};

const Select: Control = (props) => {
  const { field, ids, value, onChange } = props;
  const index = field.options.findIndex((option) => option.value === value);
  const choose = (chosen: string) => onChange(chosen === "" ? null : field.options[Number(chosen)]?.value);
  return (
    <select
      id={ids.input}
      value={value === null ? "" : String(index)}
      onChange={(event) => choose(event.currentTarget.value)}
      {...described(props)}
    >
      {field.nullable && <option value="">Automatic</option>}
      {field.options.map((option, i) => (
        <option key={option.title} value={String(i)}>
          {option.title}
        </option>
      ))}
    </select>
  );
};

const Segments: Control = (props) => (
  <div class="segments" role="radiogroup" aria-labelledby={props.ids.label} {...described(props)}>
    {props.field.options.map((option) => (
      <label key={option.title} class="segment">
        <input
          type="radio"
          name={props.ids.input}
          checked={option.value === props.value}
          onChange={() => props.onChange(option.value)}
        />
        <span>{option.title}</span>
      </label>
    ))}
  </div>
);

const Choices: Control = (props) => {
  const { field, ids, value, onChange } = props;
  const chosen = Array.isArray(value) ? value : [];
  const all = field.options.map((option) => option.value);
  const toggle = (one: unknown, on: boolean) =>
    onChange(all.filter((each) => (each === one ? on : chosen.includes(each))));
  return (
    <div class="chips" role="group" aria-labelledby={ids.label} {...described(props)}>
      {field.options.map((option) => (
        <label key={option.title} class="chip">
          <input
            type="checkbox"
            checked={chosen.includes(option.value)}
            onChange={(event) => toggle(option.value, event.currentTarget.checked)}
          />
          <span>{option.title}</span>
        </label>
      ))}
    </div>
  );
};

const TextBox: Control = (props) => (
  <input
    type="text"
    id={props.ids.input}
    autocomplete="off"
    value={typeof props.value === "string" ? props.value : ""}
    onInput={({ currentTarget: { value } }) => props.onChange(value === "" && props.field.nullable ? null : value)}
    {...described(props)}
  />
);

const JsonBox: Control = (props) => {
  const { text, type } = useText(props, jsonText, parseJson);
  return (
    <textarea
      id={props.ids.input}
      rows={2}
      spellcheck={false}
      value={text}
      onInput={(event) => type(event.currentTarget.value)}
      {...described(props)}
    />
  );
};

const jsonText = (value: unknown): string => (value === null || value === undefined ? "" : JSON.stringify(value));

function parseJson(value: string): unknown {
  if (value.trim() === "") return null;
  try {
    return JSON.parse(value);
  } catch {
    throw new Error("Enter JSON, for example [0.2, 0.5, 0.3].");
  }
}

export const CONTROLS: Record<FieldKind, Control> = {
  slider: Slider,
  number: NumberBox,
  switch: switchOf(true, false),
  onoff: switchOf("on", "off"),
  choice: Choice,
  choices: Choices,
  text: TextBox,
  json: JsonBox,
  colour: ColourBox,
  colours: ColourList,
};

/** Kinds whose control stands beside its label instead of below it. */
export const INLINE: readonly FieldKind[] = ["switch", "onoff", "colour"];

/** The settings of the chosen brush; a changed brush can be kept as an own one. */

import { useState } from "preact/hooks";
import { Slider } from "../../ui/slider";
import { type Dynamics, GRAINS, type Tip } from "../document/tip";
import type { BrushPreset } from "../drawing/brushes";
import type { Store } from "../state/store";
import { brushName } from "./brush-bar";
import { CurveField } from "./curve-field";

type Amount =
  | "hardness"
  | "flow"
  | "spacing"
  | "scatter"
  | "sizeJitter"
  | "angleJitter"
  | "roundness"
  | "wet"
  | "shade";

const AMOUNTS: [Amount, string, min: number, max: number, only?: Tip["shape"]][] = [
  ["hardness", "Hardness", 0, 1],
  ["flow", "Flow", 0.02, 1],
  ["spacing", "Spacing", 0.02, 1],
  ["roundness", "Roundness", 0.05, 1],
  ["scatter", "Scatter", 0, 1],
  ["sizeJitter", "Random size", 0, 1],
  ["angleJitter", "Random angle", 0, 1],
  ["wet", "Dark rim", 0, 1, "round"],
  ["shade", "Light and dark bristles", 0, 1, "bristles"],
];
const GRAIN_TITLES = { none: "None", paper: "Paper", rough: "Rough paper", canvas: "Canvas" } as const;
const TURNS: [Tip["turn"], string][] = [
  ["fixed", "Fixed"],
  ["path", "Along the stroke"],
  ["pen", "As the pen leans"],
];
const DYNAMICS: ["size" | "opacity" | "flowBy", string][] = [
  ["size", "size"],
  ["opacity", "opacity"],
  ["flowBy", "flow"],
];
/** Largest factor of a curve of tilt. */
const MOST_BY_TILT = 6;

const percents = (value: number): string => `${Math.round(100 * value)} %`;

export function BrushForm({ store, save }: { store: Store; save(preset: BrushPreset): void }) {
  const { tip } = store;
  if (!tip)
    return <p class="hint">A plain line, whose width follows the pressure of a pen. It has no other settings.</p>;
  const set = (change: Partial<Tip>) => setTip(store, { ...tip, ...change });
  return (
    <details class="group">
      <summary>
        <span>Settings of {brushName(store)}</span>
      </summary>
      <div class="drawing-fields">
        {AMOUNTS.filter(([, , , , only]) => !only || tip.shape === only).map(([name, label, min, max]) => (
          <Slider
            key={name}
            label={label}
            min={min}
            max={max}
            step={0.01}
            value={tip[name]}
            text={percents(tip[name])}
            onChange={(value) => set({ [name]: value })}
          />
        ))}
        {tip.shape === "bristles" && (
          <Slider
            label="Paint lasts"
            min={0}
            max={60}
            value={tip.dry}
            text={tip.dry ? `${tip.dry} widths` : "always"}
            onChange={(dry) => set({ dry })}
          />
        )}
        <Slider
          label="Angle"
          min={-180}
          max={180}
          value={tip.angle}
          text={`${Math.round(tip.angle)}°`}
          onChange={(angle) => set({ angle })}
        />
        <Choice
          label="Angle is"
          value={tip.turn}
          options={TURNS}
          onChange={(turn) => set({ turn: turn as Tip["turn"] })}
        />
        <Choice
          label="Grain"
          value={tip.grain}
          options={(["none", ...GRAINS] as const).map((name) => [name, GRAIN_TITLES[name]])}
          onChange={(grain) => set({ grain: grain as Tip["grain"], grainDepth: tip.grainDepth || 0.6 })}
        />
        {tip.grain !== "none" && (
          <>
            <Slider
              label="Grain depth"
              min={0}
              max={1}
              step={0.01}
              value={tip.grainDepth}
              text={percents(tip.grainDepth)}
              onChange={(grainDepth) => set({ grainDepth })}
            />
            <Choice
              label="Grain size"
              value={String(tip.grainScale)}
              options={["1", "2", "4"].map((scale) => [scale, `${scale} ×`])}
              onChange={(scale) => set({ grainScale: Number(scale) as Tip["grainScale"] })}
            />
          </>
        )}
      </div>
      <Curves tip={tip} set={set} />
      <KeepBrush store={store} tip={tip} save={save} />
    </details>
  );
}

function setTip(store: Store, tip: Tip): void {
  const { eraser, smudge } = store.drawing;
  const tool = store.tool.peek();
  if (tool === "eraser") eraser.value = { ...eraser.peek(), tip };
  else if (tool === "smudge") smudge.value = { ...smudge.peek(), tip };
  else store.brush.value = { ...store.brush.peek(), tip };
}

interface ChoiceProps {
  label: string;
  value: string;
  options: readonly (readonly [value: string, title: string])[];
  onChange(value: string): void;
}

function Choice({ label, value, options, onChange }: ChoiceProps) {
  return (
    <label class="choice">
      {label}
      <select value={value} onChange={(event) => onChange(event.currentTarget.value)}>
        {options.map(([name, title]) => (
          <option key={name} value={name}>
            {title}
          </option>
        ))}
      </select>
    </label>
  );
}

/** One curve at a time. */
function Curves({ tip, set }: { tip: Tip; set(change: Partial<Tip>): void }) {
  const [shown, setShown] = useState("pressure size");
  const [source, member] = shown.split(" ") as ["pressure" | "tilt", "size" | "opacity" | "flowBy"];
  const options = (["pressure", "tilt"] as const).flatMap((from) =>
    DYNAMICS.map(([name, title]): [string, string] => [
      `${from} ${name}`,
      `${from === "tilt" ? "Tilt" : "Pressure"} to ${title}`,
    ]),
  );
  const change = (curve: Dynamics["pressure"]) => set({ [member]: { ...tip[member], [source]: curve } });
  return (
    <div class="drawing-fields">
      <Choice label="Curve" value={shown} options={options} onChange={setShown} />
      <CurveField
        name={options.find(([value]) => value === shown)?.[1] ?? ""}
        ends={source === "tilt" ? ["upright", "flat"] : ["light", "full"]}
        most={source === "tilt" ? MOST_BY_TILT : 1}
        curve={tip[member][source]}
        onChange={change}
      />
    </div>
  );
}

/** Keep the changed brush under a name. */
function KeepBrush({ store, tip, save }: { store: Store; tip: Tip; save(preset: BrushPreset): void }) {
  const [name, setName] = useState("");
  const keep = (event: Event) => {
    event.preventDefault();
    const { size, opacity } = store.brush.peek();
    const scaled = (size * 1080) / Math.min(store.size.width, store.size.height);
    if (name.trim()) save({ name: name.trim(), size: scaled, opacity, tip });
    setName("");
  };
  return (
    <form class="save-style" onSubmit={keep}>
      <input
        type="text"
        aria-label="Name of your brush"
        placeholder="Name of your brush"
        maxLength={40}
        value={name}
        onInput={(event) => setName(event.currentTarget.value)}
      />
      <button type="submit" class="button small" disabled={!name.trim()}>
        Keep it
      </button>
    </form>
  );
}

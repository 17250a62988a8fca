/** Under the filmstrip: a number of the selected region's style over time, as the film has it; its keys can be dragged. */

import { signal } from "@preact/signals";
import { useState } from "preact/hooks";
import { REST, trackOf } from "../document/design";
import type { Store } from "../state/store";
import { isShown, shareOf } from "../state/timeline";
import { editStyleKey, styleContext } from "./style-keys";
import { styleAt, styleOf } from "./style-values";

/** The parameter that the lane shows: the one that the user has last changed. */
export const shownParameter = signal("");
const POINTS = 160;
/** Free room above and below the curve, as a share of its range, and at least as a share of the parameter's. */
const ROOM = 0.25;
const LEAST_ROOM = 0.02;
/** Where the curve's ends are in the lane, percent of its height from the top. */
const [TOP, BOTTOM] = [8, 92];

export function StyleLane({ store }: { store: Store }) {
  const [held, setHeld] = useState<readonly [number, number] | null>(null);
  const section = store.section("regions");
  if (!section) return null;
  const region = store.region.value || REST;
  const track = trackOf(store.design.keys, region);
  const context = styleContext(store, section);
  const numbers = (name: string) => track.map((key) => styleOf(context, key).values[name] ?? 0);
  const varying = section.sliders.find(({ name }) => new Set(numbers(name)).size > 1);
  const slider = section.sliders.find(({ name }) => name === shownParameter.value) ?? varying;
  if (track.length < 2 || !slider) return null;
  const { name, title, minimum, maximum, step } = slider;
  const span = store.span.value;
  const value = (frame: number) => styleAt(context, region, frame)?.values[name] ?? 0;
  const frames = Array.from({ length: POINTS + 1 }, (_, i) => span[0] + ((span[1] - span[0]) * i) / POINTS);
  const curve = frames.map(value);
  const [least, most] = held ?? rangeOf([...curve, ...numbers(name)], maximum - minimum);
  const height = (number: number) => BOTTOM - ((BOTTOM - TOP) * (number - least)) / (most - least);
  const course = track.map((key, i) => `${round(numbers(name)[i] ?? 0)} at frame ${key.frame + 1}`).join(", ");
  const of = region === REST ? "everything else" : region;
  const setAt = (frame: number, wanted: number) => {
    const kept = Math.min(maximum, Math.max(minimum, Math.round(wanted / step) * step));
    const change = { set: { ...track.find((key) => key.frame === frame)?.set, [name]: round(kept) } };
    shownParameter.value = name;
    editStyleKey(store, { section, region, frame }, "Drag a curve", () => change, `curve-${name}-${frame}`);
  };
  return (
    <div class="style-lane">
      <svg
        viewBox={`${span[0]} 0 ${span[1] - span[0]} 100`}
        preserveAspectRatio="none"
        role="img"
        aria-label={`${title} of ${of}: ${course}`}
      >
        <polyline points={frames.map((frame, i) => `${frame + 0.5},${height(curve[i] ?? 0)}`).join(" ")} />
        <path class="now" d={`M${store.frame.value} 0h1v100h-1z`} />
      </svg>
      {track.map(({ frame }, i) => {
        const number = numbers(name)[i] ?? 0;
        if (!isShown(frame, span)) return null;
        return (
          <div
            key={frame}
            class="curve-key"
            role="slider"
            tabIndex={0}
            aria-label={`${title} at frame ${frame + 1}`}
            aria-orientation="vertical"
            aria-valuemin={minimum}
            aria-valuemax={maximum}
            aria-valuenow={round(number)}
            title={`${title} at frame ${frame + 1}: ${round(number)}. Drag it up or down.`}
            style={{ left: `${100 * shareOf(frame + 0.5, span)}%`, top: `${height(number)}%` }}
            onPointerDown={(event) => {
              if (event.button !== 0) return;
              event.currentTarget.setPointerCapture(event.pointerId);
              setHeld([least, most]);
            }}
            onPointerMove={(event) => {
              const box = event.currentTarget.parentElement?.getBoundingClientRect();
              if (!held || !box?.height) return;
              const at = (100 * (event.clientY - box.top)) / box.height;
              setAt(frame, least + ((BOTTOM - at) / (BOTTOM - TOP)) * (most - least));
            }}
            onPointerUp={() => setHeld(null)}
            onPointerCancel={() => setHeld(null)}
            onKeyDown={(event) => {
              const by = { ArrowUp: step, ArrowDown: -step }[event.key];
              if (!by) return;
              event.preventDefault();
              event.stopPropagation();
              setAt(frame, number + by);
            }}
          />
        );
      })}
      <select
        aria-label="Number in the plot"
        value={name}
        onChange={(event) => {
          shownParameter.value = event.currentTarget.value;
        }}
      >
        {section.sliders.map((one) => (
          <option key={one.name} value={one.name}>
            {one.title}
          </option>
        ))}
      </select>
      <span aria-hidden="true">{round(value(store.frame.value))}</span>
    </div>
  );
}

function rangeOf(values: readonly number[], whole: number): [number, number] {
  const [least, most] = [Math.min(...values), Math.max(...values)];
  const room = Math.max(ROOM * (most - least), LEAST_ROOM * whole);
  return [least - room, most + room];
}

const round = (value: number): number => Math.round(100 * value) / 100;

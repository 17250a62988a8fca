/** Under the filmstrip: a number of the selected region's style over time, as the film has it; its keys can be dragged. */

import { signal } from "@preact/signals";
import { round, ValueCurve } from "../../ui/value-curve";
import { REST, trackOf } from "../document/design";
import type { Store } from "../state/store";
import { editStyleKey, styleContext } from "./style-keys";
import { contextAt, styleAt, styleOf } from "./style-values";

/** The parameter that the lane shows: the one that the user has last changed. */
export const shownParameter = signal("");

export function StyleLane({ store }: { store: Store }) {
  const section = store.section("regions");
  if (!section) return null;
  const region = store.region.value || REST;
  const track = trackOf(store.design.keys, region);
  const context = styleContext(store, section);
  const numbers = (name: string) => track.map((key) => styleOf(contextAt(context, key.frame), key).values[name] ?? 0);
  const varying = section.sliders.find(({ name }) => new Set(numbers(name)).size > 1);
  const slider = section.sliders.find(({ name }) => name === shownParameter.value) ?? varying;
  if (track.length < 2 || !slider) return null;
  const { name, title, minimum, maximum, step } = slider;
  const value = (frame: number) => styleAt(context, region, frame)?.values[name] ?? 0;
  const setAt = (frame: number, wanted: number) => {
    const change = { set: { ...track.find((key) => key.frame === frame)?.set, [name]: wanted } };
    shownParameter.value = name;
    editStyleKey(store, { section, region, frame }, "Drag a curve", () => change, `curve-${name}-${frame}`);
  };
  return (
    <div class="style-lane value-curve">
      <ValueCurve
        span={store.span.value}
        frame={store.frame.value}
        keys={track.map(({ frame }, i) => [frame, numbers(name)[i] ?? 0])}
        value={value}
        minimum={minimum}
        maximum={maximum}
        step={step}
        title={title}
        of={region === REST ? "everything else" : region}
        onSet={setAt}
      />
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

/** Under the filmstrip: a parameter of the selected region's style over time, between its keys. */

import { signal } from "@preact/signals";
import { humanise } from "../../ui/format";
import { type StyleKey, trackOf } from "../document/design";
import type { Store } from "../state/store";
import { valueAt } from "../state/timeline";
import { REST } from "./direction-tool";

/** The parameter that the lane shows: the one that the user has last changed. */
export const shownParameter = signal("");
const POINTS = 160;

export function StyleLane({ store }: { store: Store }) {
  const section = store.section("regions");
  if (!section) return null;
  const region = store.region.value || REST;
  const track = trackOf(store.design.keys, region);
  const known = shownBy(track);
  const name = known.includes(shownParameter.value) ? shownParameter.value : known[0];
  if (track.length < 2 || !name) return null;
  const keys = track.map(({ frame, set, ease = "linear" }) => ({ frame, value: Number(set?.[name]), ease }));
  const span = store.span.value;
  const values = keys.map(({ value }) => value);
  const [least, most] = [Math.min(...values), Math.max(...values)];
  const value = (frame: number) => valueAt(keys, frame, name) ?? least;
  const height = (frame: number) => 92 - (84 * (value(frame) - least)) / Math.max(1e-6, most - least);
  const frames = Array.from({ length: POINTS + 1 }, (_, i) => span[0] + ((span[1] - span[0]) * i) / POINTS);
  const course = keys.map((key) => `${key.value} at frame ${key.frame + 1}`).join(", ");
  const title = section.sliders.find((slider) => slider.name === name)?.title ?? humanise(name);
  return (
    <div class="style-lane">
      <svg
        viewBox={`${span[0]} 0 ${span[1] - span[0]} 100`}
        preserveAspectRatio="none"
        role="img"
        aria-label={`${title} of ${region === REST ? "everything else" : region}: ${course}`}
      >
        <polyline points={frames.map((frame) => `${frame + 0.5},${height(frame)}`).join(" ")} />
        <path class="now" d={`M${store.frame.value} 0h1v100h-1z`} />
      </svg>
      <span aria-hidden="true">
        {title} {Math.round(100 * value(store.frame.value)) / 100}
      </span>
    </div>
  );
}

/** Parameters that every key of the track sets. For others, the page does not have the style's own value. */
const shownBy = (track: readonly StyleKey[]): string[] =>
  Object.keys(track[0]?.set ?? {}).filter((name) => track.every(({ set }) => typeof set?.[name] === "number"));

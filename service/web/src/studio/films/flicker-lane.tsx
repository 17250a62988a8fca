/** Under the filmstrip while the flicker is shown: its figure in this frame, over time, and the worst frames. */

import type { Store } from "../state/store";
import { frameAt } from "../state/timeline";
import { type Flicker, worstFrames } from "./flicker";

export function FlickerLane({ store, flicker }: { store: Store; flicker: Flicker }) {
  if (store.stageView.value !== "flicker") return null;
  const measured = flicker.measured.value;
  const film = store.film.value;
  return (
    <div class="flicker-lane">
      {measured.size > 0 && <FlickerBars store={store} flicker={flicker} />}
      <div class="flicker-tools">
        <p role="status">{sentence(store, flicker)}</p>
        {film && (
          <label class="inline-field">
            Measured on
            <select
              value={flicker.ofPreviews.value ? "previews" : "film"}
              onChange={(event) => {
                flicker.ofPreviews.value = event.currentTarget.value === "previews";
              }}
            >
              <option value="film">the newest film</option>
              <option value="previews">previews</option>
            </select>
          </label>
        )}
        <div class="actions" role="group" aria-label="Frames with the most flicker">
          {worstFrames(measured).map((frame) => (
            <button key={frame} type="button" class="chip-button" onClick={() => store.goTo(frame)}>
              Frame {frame + 1} · {(measured.get(frame)?.flicker ?? 0).toFixed(1)}
            </button>
          ))}
          <button
            type="button"
            class="button small"
            disabled={flicker.measuring.value}
            onClick={() => void flicker.measure()}
          >
            {flicker.measuring.value ? "Measuring…" : "Find the worst frames"}
          </button>
        </div>
      </div>
    </div>
  );
}

function sentence(store: Store, flicker: Flicker): string {
  const heat = flicker.heat.value;
  if (!store.previews.value) return "This service makes no previews of projects, so that flicker cannot be shown.";
  if (heat?.frame !== store.frame.value) return "Measuring the flicker of this frame…";
  if (heat.flicker === null) return "The first frame of a shot follows no other: there is nothing to compare.";
  return `Flicker of this frame: ${heat.flicker.toFixed(1)} (1: as steady as the source). Yellow to red: where.`;
}

function FlickerBars({ store, flicker }: { store: Store; flicker: Flicker }) {
  const measured = flicker.measured.value;
  const span = store.span.value;
  const worst = new Set(worstFrames(measured));
  const most = Math.max(1e-6, ...[...measured.values()].map(({ error }) => error ?? 0));
  const bars = (wanted: boolean) =>
    [...measured]
      .filter(([frame]) => worst.has(frame) === wanted)
      .map(([frame, { error }]) => `M${frame} 100h1v${-Math.round((100 * (error ?? 0)) / most)}h-1z`)
      .join("");
  const choose = (event: MouseEvent) => {
    const box = (event.currentTarget as Element).getBoundingClientRect();
    store.goTo(frameAt(event.clientX - box.left, box.width, span));
  };
  return (
    <svg
      viewBox={`${span[0]} 0 ${span[1] - span[0]} 100`}
      preserveAspectRatio="none"
      role="img"
      aria-label={`Flicker of ${measured.size} frames`}
      onPointerDown={choose}
    >
      <path class="doubt" d={bars(false)} />
      <path class="worst" d={bars(true)} />
      <path class="now" d={`M${store.frame.value} 0h1v100h-1z`} />
    </svg>
  );
}

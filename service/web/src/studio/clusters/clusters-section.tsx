/** The clusters of a layer: show them, paint and merge labels, choose the frames that are solved again. */

import type { Section } from "../../api/schemas";
import { Icon } from "../../ui/icons";
import type { Store } from "../state/store";
import { type Clusters, worst } from "./clusters";
import { areas, colourOf, joined, solvedFrames, titleOf } from "./label-edits";

interface ClustersProps {
  store: Store;
  section: Section;
  clusters: Clusters;
  /** Paint the film; only what depends on the corrections runs again. */
  solve(): void;
}

export function ClustersSection({ store, section, clusters, solve }: ClustersProps) {
  const available = clusters.available.value;
  return (
    <section class="side-section" aria-labelledby="clusters-title">
      <h2 id="clusters-title">{section.title}</h2>
      {!available && (
        <p class="hint">Each moving object is one cluster. Find them now, or paint the film; then correct them here.</p>
      )}
      {store.previews.value && <Search store={store} clusters={clusters} />}
      {available && <ClusterTools store={store} section={section} clusters={clusters} solve={solve} />}
    </section>
  );
}

/** Finds the clusters before a film. */
function Search({ store, clusters }: { store: Store; clusters: Clusters }) {
  const found = clusters.found.value.size;
  const start = () => {
    clusters.shown.value = true;
    void clusters.searchAll();
  };
  if (clusters.searching.value)
    return (
      <div class="actions">
        <p role="status">
          Clusters of {found} of {store.frames} frames are found.
        </p>
        <button type="button" class="button small" onClick={() => clusters.forget()}>
          Stop
        </button>
      </div>
    );
  if (found) return <p class="hint">These clusters were found with the present settings and marks.</p>;
  return (
    <div class="actions">
      <button type="button" class="button small" onClick={start}>
        {clusters.film.value ? "Find them again with the present settings" : "Find the clusters"}
      </button>
    </div>
  );
}

function ClusterTools({ store, section, clusters, solve }: ClustersProps) {
  const map = clusters.map.value;
  const shown = clusters.shown.value;
  const { corrections } = clusters;
  const next = mostUncertain(clusters);
  const show = (yes: boolean) => {
    clusters.shown.value = yes;
    if (!yes && store.tool.value === "label") store.tool.value = "pan";
  };
  const again = solvedFrames(corrections, store.frames);
  return (
    <>
      <p class="hint">
        {clusters.found.value.size === 0 && "The clusters are those of the newest film. "}
        The higher a bar below the frames, the more uncertain.
      </p>
      <label class="check-field">
        <input type="checkbox" checked={shown} onChange={(event) => show(event.currentTarget.checked)} />
        {section.overlay?.title}
      </label>
      <div class="actions">
        <button
          type="button"
          class="button small"
          disabled={next === null}
          onClick={() => {
            show(true);
            if (next !== null) store.goTo(next);
          }}
        >
          Go to the most uncertain frame
        </button>
      </div>
      {shown && map?.frame === store.frame.value && <LabelList store={store} clusters={clusters} />}
      {clusters.correction(store.frame.value) && <Interval store={store} clusters={clusters} />}
      {corrections.length > 0 && (
        <button type="button" class="button" onClick={solve}>
          <Icon name="retry" />
          Solve {again} {again === 1 ? "frame" : "frames"} again
        </button>
      )}
    </>
  );
}

/** The least certain frame that no correction covers yet. */
function mostUncertain(clusters: Clusters): number | null {
  const covered = (frame: number) =>
    clusters.corrections.some(({ solve }) => !solve || (solve[0] <= frame && frame < solve[1]));
  let best: [number, number] | null = null;
  for (const [frame, labels] of clusters.uncertainty.value) {
    const value = worst(labels);
    if (!covered(frame) && value > (best?.[1] ?? 0)) best = [frame, value];
  }
  return best?.[0] ?? null;
}

function LabelList({ store, clusters }: { store: Store; clusters: Clusters }) {
  const map = clusters.map.value;
  if (!map) return null;
  const chosen = clusters.label.value;
  const doubt = clusters.uncertainty.value.get(map.frame) ?? {};
  const listed = areas(map);
  const known = listed.some(([label]) => label === chosen);
  const choose = (label: number) => {
    clusters.label.value = label;
    store.tool.value = "label";
  };
  const merge = (into: number) => {
    clusters.correct("Merge clusters", map.frame, joined(map, chosen, into));
    clusters.label.value = into;
  };
  return (
    <>
      <div class="label-chips" role="group" aria-label="Paint with the label">
        {[...listed, ...(known ? [] : [[chosen, 0] as const])].map(([label, share]) => (
          <button
            key={label}
            type="button"
            class="chip-button"
            aria-pressed={chosen === label && store.tool.value === "label"}
            onClick={() => choose(label)}
          >
            <Swatch label={label} />
            {titleOf(label)}
            <small>
              {Math.round(100 * share)} %
              {(doubt[label] ?? 0) >= 0.2 && `, uncertain ${Math.round(100 * (doubt[label] ?? 0))} %`}
            </small>
          </button>
        ))}
        <button type="button" class="chip-button" onClick={() => choose(clusters.largest + 1)}>
          <Icon name="plus" />
          New object
        </button>
      </div>
      <p class="hint">Choose a label and paint over the frame. Alt takes up the label under the pointer.</p>
      {known && listed.length > 1 && (
        <label class="inline-field">
          Merge {titleOf(chosen)} with
          <select
            value=""
            onChange={(event) => {
              merge(Number(event.currentTarget.value));
              event.currentTarget.value = "";
            }}
          >
            <option value="">choose</option>
            {listed
              .filter(([label]) => label !== chosen)
              .map(([label]) => (
                <option key={label} value={label}>
                  {titleOf(label)}
                </option>
              ))}
          </select>
        </label>
      )}
    </>
  );
}

function Swatch({ label }: { label: number }) {
  const [r, g, b] = colourOf(label);
  return (
    <svg viewBox="0 0 12 12" class="swatch" aria-hidden="true">
      <rect width="12" height="12" rx="3" fill={`rgb(${r} ${g} ${b})`} />
    </svg>
  );
}

/** The first and the last frame that the correction of the shown frame solves again. */
function Interval({ store, clusters }: { store: Store; clusters: Clusters }) {
  const frame = store.frame.value;
  const [from, until] = clusters.correction(frame)?.solve ?? [0, store.frames];
  const field = (title: string, value: number, least: number, most: number, set: (to: number) => [number, number]) => (
    <label>
      {title}
      <input
        type="number"
        min={least}
        max={most}
        value={value}
        onChange={(event) => {
          const wanted = Number(event.currentTarget.value);
          if (Number.isInteger(wanted)) clusters.setInterval(frame, set(Math.min(most, Math.max(least, wanted))));
        }}
      />
    </label>
  );
  return (
    <fieldset class="interval">
      <legend>This correction changes frames</legend>
      {field("from", from + 1, 1, frame + 1, (to) => [to - 1, until])}
      {field("to", until, frame + 1, store.frames, (to) => [from, to])}
      <button type="button" class="button small" onClick={() => clusters.remove(frame)}>
        <Icon name="trash" />
        Remove the correction
      </button>
    </fieldset>
  );
}

/** Directions of the strokes of the selected region. */

import { Icon } from "../../ui/icons";
import { Slider, type SliderProps } from "../../ui/slider";
import {
  type Design,
  type DirectionElement,
  type DirectionKey,
  type Ease,
  type Pattern,
  putOnTrack,
  REST,
  removeFromTrack,
  trackOf,
} from "../document/design";
import { keyAt } from "../document/document";
import { distanceOf } from "../drawing/geometry";
import type { Store } from "../state/store";
import { EDGE_WEIGHT, editDirections, editElements, pattern, presentKey, selectedElement } from "./direction-tool";
import type { FilmView } from "./film-view";
import { EASES } from "./style-keys";
import type { Field } from "./true-field";

const PATTERNS: [Pattern, string][] = [
  ["regular", "Parallel"],
  ["center", "Circles"],
  ["spiral", "Spiral"],
  ["node", "Rays"],
  ["saddle", "Crossing"],
  ["wedge", "Round one end"],
  ["trisector", "Three ways"],
];
/** Reach of an element that no longer reaches everywhere, heights of the picture. */
const REACH = 0.35;

interface DirectionsProps {
  store: Store;
  field: FilmView<Field>;
}

export function Directions({ store, field }: DirectionsProps) {
  const key = presentKey(store);
  const selected = key?.elements[selectedElement.value];
  const pick = (value: Pattern) => {
    pattern.value = value;
    store.tool.value = "direction";
    if (selected) changeElement(store, { pattern: value });
  };
  return (
    <section class="side-section" aria-labelledby="directions-title">
      <h2 id="directions-title">Directions</h2>
      <p class="hint">Choose a pattern, press on the stage and drag: the strokes of the region follow it.</p>
      <div class="chips" role="group" aria-label="Pattern">
        {PATTERNS.map(([value, title]) => (
          <button
            key={value}
            type="button"
            class="chip-button"
            aria-pressed={pattern.value === value}
            onClick={() => pick(value)}
          >
            {title}
          </button>
        ))}
      </div>
      {selected && <Element store={store} element={selected} />}
      {store.tool.value === "direction" && store.previews.value && (
        <p class="hint" role="status">
          {fieldText(field)}
        </p>
      )}
      <More store={store} />
    </section>
  );
}

function fieldText(field: FilmView<Field>): string {
  if (field.problem.value) return field.problem.value;
  const found = field.present;
  if (!found) return "Finding the directions of this frame…";
  return found.final
    ? "The stage shows the directions of the film."
    : "The stage shows the directions of this frame alone; finding those of the film…";
}

function changeElement(store: Store, to: Partial<DirectionElement>): void {
  const changed = (elements: readonly DirectionElement[]) =>
    elements.map((one, i) => (i === selectedElement.value ? { ...one, ...to } : one));
  editElements(store, "Change a direction", changed, "direction-element");
}

const Row = (props: SliderProps) => (
  <div class="style-slider-row">
    <Slider {...props} />
  </div>
);

/** The selected element. */
function Element({ store, element }: { store: Store; element: DirectionElement }) {
  const { strength = 1 } = element;
  const angle = (((element.angle ?? 0) + 540) % 360) - 180;
  const reach = distanceOf(element.reach);
  const drop = () => {
    editElements(store, "Remove a direction", (list) => list.filter((_, i) => i !== selectedElement.value));
    selectedElement.value = -1;
  };
  const percent = `${Math.round(100 * reach)} %`;
  return (
    <>
      <Row
        label="Strength"
        min={0}
        max={5}
        step={0.1}
        value={strength}
        text={String(strength)}
        onChange={(value) => changeElement(store, { strength: value })}
      />
      <Row
        label="Angle"
        min={-180}
        max={180}
        value={angle}
        text={`${Math.round(angle)}°`}
        onChange={(value) => changeElement(store, { angle: value })}
      />
      <Row
        label="Reach"
        min={0.02}
        max={2}
        step={0.01}
        value={reach || 2}
        text={reach ? percent : "everywhere"}
        onChange={(value) => changeElement(store, { reach: value })}
      />
      <label class="check-row">
        <input
          type="checkbox"
          checked={!reach}
          onChange={(event) => changeElement(store, { reach: event.currentTarget.checked ? "everywhere" : REACH })}
        />
        Everywhere in the region alike
      </label>
      <button type="button" class="button small" onClick={drop}>
        <Icon name="trash" />
        Remove this direction
      </button>
    </>
  );
}

const withDirections = (design: Design, key: DirectionKey): Design => ({
  ...design,
  directions: putOnTrack(design.directions, key),
});

/** What holds for all elements of the region's key. */
function More({ store }: { store: Store }) {
  const region = store.region.value || REST;
  const frame = store.frame.value;
  const key = presentKey(store);
  const track = trackOf(store.design.directions, region);
  const { edge_weight: weight = EDGE_WEIGHT, follow = true, free = false, ease = "linear" } = key ?? {};
  const some = Boolean(key?.elements.length);
  const drop = () =>
    store.editDesign("Remove a key of directions", (design) => ({
      ...design,
      directions: removeFromTrack(design.directions, region, frame),
    }));
  return (
    <details class="more-settings">
      <summary>All settings of the directions</summary>
      <label class="check-row">
        <input
          type="checkbox"
          checked={free}
          onChange={(event) => {
            const to = event.currentTarget.checked;
            editDirections(store, "Change where directions come from", () => ({ free: to }));
          }}
        />
        Take the directions of the surroundings
      </label>
      {some && !free && (
        <>
          <Row
            label="Edges of the picture"
            min={0}
            max={1}
            step={0.05}
            value={weight}
            text={`${Math.round(100 * weight)} %`}
            onChange={(value) =>
              editDirections(store, "Change the weight of edges", () => ({ edge_weight: value }), "edge-weight")
            }
          />
          {region !== REST && (
            <label class="check-row">
              <input
                type="checkbox"
                checked={follow}
                onChange={(event) => {
                  const to = event.currentTarget.checked;
                  editDirections(store, "Change what directions follow", () => ({ follow: to }));
                }}
              />
              Move, turn and stretch with the region
            </label>
          )}
        </>
      )}
      {track.length > 1 && (
        <label class="inline-field">
          Directions change to the next key
          <select
            value={ease}
            onChange={(event) => {
              const to = event.currentTarget.value as Ease;
              const before = keyAt(track, frame);
              const held = before && { ...before, ease: to };
              if (held) store.editDesign("Change the easing", (design) => withDirections(design, held));
            }}
          >
            {EASES.map(([one, title]) => (
              <option key={one} value={one}>
                {title}
              </option>
            ))}
          </select>
        </label>
      )}
      {track.length > 0 && (
        <p class="hint">
          {track.length > 1 ? "Keys at frames" : "Key at frame"} {track.map((one) => one.frame + 1).join(", ")}.
        </p>
      )}
      {key?.frame === frame && (
        <button type="button" class="button small" onClick={drop}>
          <Icon name="trash" />
          Remove the directions of this frame
        </button>
      )}
    </details>
  );
}

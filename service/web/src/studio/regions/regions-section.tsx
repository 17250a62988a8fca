/** Regions of a layer: their styles over time, and the directions of their strokes. */

import { useEffect, useState } from "preact/hooks";
import * as api from "../../api/api";
import type { Section } from "../../api/schemas";
import { humanise } from "../../ui/format";
import { Icon, IconButton } from "../../ui/icons";
import {
  type Design,
  type Ease,
  mergeRegions,
  type Pattern,
  putOnTrack,
  removeFromTrack,
  removeRegion,
  renameRegion,
  type StyleKey,
  trackOf,
  withRegion,
} from "../document/design";
import { type Layer, withPart } from "../document/document";
import type { Store } from "../state/store";
import { styleAt } from "../state/timeline";
import { StyleCards } from "../styles/style-cards";
import { editElements, pattern, presentKey, REST, selectedElement } from "./direction-tool";
import { objectCount, type RegionsState, regionsState } from "./region-tool";
import { shownParameter } from "./style-lane";

interface RegionsProps {
  store: Store;
  section: Section;
}

export function RegionsSection({ store, section }: RegionsProps) {
  return (
    <>
      <Effects store={store} section={section} />
      <RegionList store={store} section={section} />
      <StyleKeys store={store} section={section} />
      <Directions store={store} />
    </>
  );
}

/** Ready-made designs, which are edited like one's own. */
function Effects({ store, section }: RegionsProps) {
  const [effects, setEffects] = useState<Record<string, Design>>({});
  const { frames } = store;
  const { name: method = "", inputs = [] } = store.method.value ?? {};
  const input = inputs.find(({ kind, part }) => kind === "json" && part === section.part)?.name;
  useEffect(() => {
    if (!input) return;
    const controller = new AbortController();
    const path = api.url`/v1/methods/${method}/inputs/${input}/examples?frames=${frames}`;
    api.get<Record<string, Design>>(path, controller.signal).then(setEffects, () => {});
    return () => controller.abort();
  }, [method, input, frames]);
  const use = (name: string) => {
    const design = effects[name];
    if (design) store.editLayer(`Begin with ${humanise(name)}`, (layer) => withDesign(layer, section, design));
    store.region.value = "";
  };
  if (!Object.keys(effects).length) return null;
  return (
    <label class="inline-field">
      Begin with an effect
      <select value="" onChange={(event) => use(event.currentTarget.value)}>
        <option value="">choose one</option>
        {Object.keys(effects).map((name) => (
          <option key={name} value={name}>
            {humanise(name)}
          </option>
        ))}
      </select>
    </label>
  );
}

/** The layer with another design, instead of its own and of what its parameters say of one. */
function withDesign(layer: Layer, { part, replaces }: Section, { regions, keys, directions }: Design): Layer {
  const params = Object.fromEntries(Object.entries(layer.params ?? {}).filter(([name]) => !replaces.includes(name)));
  const { styles } = (layer.parts?.[part] as Design | undefined) ?? {};
  return withPart({ ...layer, params }, part, { regions, ...(styles && { styles }), keys, directions });
}

/** Regions by name, with `rest` for all pixels that no region has. */
const regionNames = (design: Design): string[] => [REST, ...Object.keys(design.regions ?? {})];

function RegionList({ store, section }: RegionsProps) {
  const { design } = store;
  const names = regionNames(design);
  const selected = store.region.value || REST;
  const state = regionsState.value;
  const merge = (other: string) => store.editDesign("Merge regions", (one) => mergeRegions(one, [selected, other]));
  const sameKind = names.filter(
    (name) =>
      name !== selected && name !== REST && selected !== REST && kindOf(design, name) === kindOf(design, selected),
  );
  return (
    <section class="side-section" aria-labelledby="regions-title">
      <h2 id="regions-title">{section.title}</h2>
      <p class="hint">{regionsHint(state, store.previews.value)}</p>
      <ul class="region-list">
        {names.map((name) => (
          <li key={name} aria-current={name === selected ? "true" : undefined}>
            <button
              type="button"
              class="layer-name"
              aria-pressed={name === selected}
              onClick={() => choose(store, name)}
            >
              {name === REST ? "Everything else" : name}
            </button>
            {name !== REST && (
              <>
                <IconButton name="picker" label={`Rename ${name}`} onClick={() => rename(store, name)} />
                <IconButton name="trash" label={`Remove ${name}`} onClick={() => remove(store, name)} />
              </>
            )}
          </li>
        ))}
      </ul>
      {sameKind.length > 0 && (
        <label class="inline-field">
          Merge with
          <select value="" onChange={(event) => event.currentTarget.value && merge(event.currentTarget.value)}>
            <option value="">choose a region</option>
            {sameKind.map((name) => (
              <option key={name}>{name}</option>
            ))}
          </select>
        </label>
      )}
    </section>
  );
}

function regionsHint(state: RegionsState, previews: boolean): string {
  if (state === "loading") return "Finding what moves together in this shot…";
  if (!previews || state === "missing")
    return "Draw a region on the stage with the lasso; draw it again in other frames.";
  const count = objectCount.value;
  const one = state === "ready" && count > 0 ? `one of the ${count} objects of this frame` : "an object on the stage";
  return `Pick ${one}: click it. Shift adds to the region, Alt makes the part of it under a click or a stroke a region of its own. Or draw with the lasso.`;
}

function kindOf(design: Design, name: string): string {
  const { objects, tubes, polygons } = design.regions?.[name] ?? {};
  if (polygons?.length) return "polygons";
  return tubes?.length ? "tubes" : objects?.length ? "objects" : "label";
}

function choose(store: Store, name: string): void {
  store.region.value = name === REST ? "" : name;
  selectedElement.value = -1;
}

function remove(store: Store, name: string): void {
  store.editDesign("Remove a region", (design) => removeRegion(design, name));
  store.region.value = "";
}

const NAME = /^[A-Za-z][A-Za-z0-9_. -]{0,63}$/;

function rename(store: Store, from: string): void {
  const to = window.prompt("Name of the region (letters, digits, spaces)", from)?.trim() ?? "";
  if (!NAME.test(to) || to in (store.design.regions ?? {}) || to === REST) return;
  store.editDesign("Rename a region", (design) => renameRegion(design, from, to));
  store.region.value = to;
}

// -- styles -----------------------------------------------------------------------------------------------------------

const EASES: [Ease, string][] = [
  ["linear", "Steadily"],
  ["smooth", "Smoothly"],
  ["in", "Slowly at first"],
  ["out", "Slowly at the end"],
  ["hold", "At once, at the next key"],
];

function StyleKeys({ store, section }: RegionsProps) {
  const region = store.region.value || REST;
  const track = trackOf(store.design.keys, region);
  const key = styleAt(track, store.frame.value);
  const exact = key?.frame === store.frame.value;
  const edit = (label: string, change: Partial<StyleKey>, group = "") => {
    const next: StyleKey = { ...key, ...change, region, frame: store.frame.value };
    const keyed = (design: Design) => ({ ...design, keys: putOnTrack(design.keys, next) });
    store.editDesign(label, (design) => withBorder(keyed(design), region), group);
  };
  const drop = () =>
    store.editDesign("Remove a style key", (design) => ({
      ...design,
      keys: removeFromTrack(design.keys, region, store.frame.value),
    }));
  return (
    <section class="side-section" aria-labelledby="styles-title">
      <h2 id="styles-title">Style of {region === REST ? "everything else" : region}</h2>
      <StyleCards
        store={store}
        section={section}
        chosen={key?.style ?? ""}
        onChoose={(style) => edit("Choose a style", { style })}
      />
      {key && (
        <>
          {section.sliders.map(({ name, title, minimum, maximum, step }) => (
            <StyleSlider
              key={name}
              title={title}
              min={minimum}
              max={maximum}
              step={step}
              value={key.set?.[name]}
              onChange={(value) => {
                shownParameter.value = name;
                edit(`Change ${title.toLowerCase()}`, { set: changed(key, name, value) }, `style-${name}`);
              }}
            />
          ))}
          <label class="inline-field">
            Change to the next key
            <select
              value={key.ease ?? "linear"}
              onChange={(event) => edit("Change the easing", { ease: event.currentTarget.value as Ease })}
            >
              {EASES.map(([ease, title]) => (
                <option key={ease} value={ease}>
                  {title}
                </option>
              ))}
            </select>
          </label>
        </>
      )}
      <p class="hint">
        {track.length
          ? `${track.length > 1 ? "Keys at frames" : "Key at frame"} ${track.map((one) => one.frame + 1).join(", ")}. `
          : ""}
        {key && !exact ? "A change here makes a key at this frame." : ""}
        {!key && store.design.keys?.length ? "Without a style of its own, it takes those of the others." : ""}
      </p>
      {exact && (
        <button type="button" class="button small" onClick={drop}>
          <Icon name="trash" />
          Remove the key at this frame
        </button>
      )}
    </section>
  );
}

/** The design with a border round the region across which its style does not spread, unless it has a border already: the
 * style is for this region only. */
function withBorder(design: Design, name: string): Design {
  const region = design.regions?.[name];
  return region && !region.border ? withRegion(design, name, { ...region, border: "sharp" }) : design;
}

function changed(key: StyleKey, name: string, value: number | undefined): StyleKey["set"] {
  const { [name]: _old, ...rest } = key.set ?? {};
  return value === undefined ? rest : { ...rest, [name]: value };
}

interface StyleSliderProps {
  title: string;
  min: number;
  max: number;
  step: number;
  value: unknown | undefined;
  onChange(value: number | undefined): void;
}

/** A parameter of the style, unchanged until it is moved. */
function StyleSlider({ title, min, max, step, value, onChange }: StyleSliderProps) {
  const set = typeof value === "number";
  return (
    <label class="style-slider">
      <span>{title}</span>
      <input
        type="range"
        min={min}
        max={max}
        step={step}
        value={set ? value : (min + max) / 2}
        class={set ? "" : "unset"}
        aria-label={title}
        onInput={(event) => onChange(Number(event.currentTarget.value))}
      />
      <output>{set ? value : "style's own"}</output>
      {set && <IconButton name="retry" label={`Reset ${title}`} onClick={() => onChange(undefined)} />}
    </label>
  );
}

// -- directions -------------------------------------------------------------------------------------------------------

const PATTERNS: [Pattern, string][] = [
  ["regular", "Parallel"],
  ["center", "Circles"],
  ["spiral", "Spiral"],
  ["node", "Rays"],
  ["saddle", "Crossing"],
  ["wedge", "Round one end"],
];

function Directions({ store }: { store: Store }) {
  const key = presentKey(store);
  const elements = key?.elements ?? [];
  const selected = elements[selectedElement.value];
  const angle = (((selected?.angle ?? 0) + 180) % 360) - 180;
  const pick = (value: Pattern) => {
    pattern.value = value;
    store.tool.value = "direction";
    if (selected) change({ pattern: value });
  };
  const change = (to: Partial<NonNullable<typeof selected>>) =>
    editElements(
      store,
      "Change a direction",
      (list) => list.map((one, i) => (i === selectedElement.value ? { ...one, ...to } : one)),
      "direction-element",
    );
  const drop = () => {
    editElements(store, "Remove a direction", (list) => list.filter((_, i) => i !== selectedElement.value));
    selectedElement.value = -1;
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
      {selected && (
        <>
          <label class="style-slider">
            <span>Strength</span>
            <input
              type="range"
              min={0}
              max={5}
              step={0.1}
              value={selected.strength ?? 1}
              aria-label="Strength"
              onInput={(event) => change({ strength: Number(event.currentTarget.value) })}
            />
            <output>{selected.strength ?? 1}</output>
          </label>
          <label class="style-slider">
            <span>Angle</span>
            <input
              type="range"
              min={-180}
              max={180}
              step={1}
              value={angle}
              aria-label="Angle"
              onInput={(event) => change({ angle: Number(event.currentTarget.value) })}
            />
            <output>{angle}°</output>
          </label>
          <label class="style-slider">
            <span>Reach</span>
            <input
              type="range"
              min={0.02}
              max={2}
              step={0.01}
              value={selected.reach || 2}
              aria-label="Reach"
              onInput={(event) => change({ reach: Number(event.currentTarget.value) })}
            />
            <output>{selected.reach ? `${Math.round(100 * selected.reach)} %` : "everywhere"}</output>
          </label>
          <button type="button" class="button small" onClick={drop}>
            <Icon name="trash" />
            Remove this direction
          </button>
        </>
      )}
    </section>
  );
}

/** Regions of a layer: their styles over time, and the directions of their strokes. */

import { useEffect, useState } from "preact/hooks";
import * as api from "../../api/api";
import type { Section } from "../../api/schemas";
import { humanise } from "../../ui/format";
import { Icon, IconButton } from "../../ui/icons";
import { canMerge, type Design, mergeRegions, REST, removeRegion, renameRegion, withRegion } from "../document/design";
import { type Layer, withPart } from "../document/document";
import { MAX_BRUSH_PX, type Store } from "../state/store";
import { correctionsHere, removeCorrections } from "./correction-tool";
import { selectedElement } from "./direction-tool";
import { Directions } from "./directions-section";
import type { FilmView } from "./film-view";
import type { RegionMaps } from "./region-map";
import { objectCount, type RegionsState, regionsState, segmentationShown } from "./region-tool";
import { StyleKeys } from "./style-keys";
import type { Field } from "./true-field";

export interface RegionsProps {
  store: Store;
  section: Section;
}

export interface RegionsSectionProps extends RegionsProps {
  maps: RegionMaps;
  field: FilmView<Field>;
}

export function RegionsSection({ store, section, maps, field }: RegionsSectionProps) {
  return (
    <>
      <Effects store={store} section={section} />
      <RegionList store={store} section={section} maps={maps} />
      <StyleKeys store={store} section={section} />
      <Directions store={store} field={field} />
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
const regionNames = (design: Design): string[] => [
  REST,
  ...Object.keys(design.regions ?? {}).filter((name) => name !== REST),
];

function RegionList({ store, section, maps }: RegionsProps & { maps: RegionMaps }) {
  const { design } = store;
  const names = regionNames(design);
  const selected = store.region.value || REST;
  const state = regionsState.value;
  const merge = (other: string) => store.editDesign("Merge regions", (one) => mergeRegions(one, [selected, other]));
  const others = names.filter(
    (name) =>
      ![REST, selected].includes(name) &&
      selected !== REST &&
      canMerge(design.regions?.[name], design.regions?.[selected]),
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
              onClick={() => choose(store, name === selected ? REST : name)}
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
      {others.length > 0 && (
        <label class="inline-field">
          Merge with
          <select value="" onChange={(event) => event.currentTarget.value && merge(event.currentTarget.value)}>
            <option value="">choose a region</option>
            {others.map((name) => (
              <option key={name}>{name}</option>
            ))}
          </select>
        </label>
      )}
      {selected !== REST && (
        <label class="inline-field">
          At its border
          <select
            value={design.regions?.[selected]?.border ?? "plain"}
            onChange={(event) => setBorder(store, selected, event.currentTarget.value)}
          >
            {BORDERS.map(([border, title]) => (
              <option key={border} value={border}>
                {title}
              </option>
            ))}
          </select>
        </label>
      )}
      <details class="more-settings">
        <summary>The segmentation</summary>
        <label class="check-row">
          <input
            type="checkbox"
            checked={segmentationShown.value}
            disabled={!store.previews.value || state === "missing"}
            onChange={(event) => {
              segmentationShown.value = event.currentTarget.checked;
            }}
          />
          Show all objects and their parts
        </label>
        <Corrections store={store} of={selected === REST ? "everything else" : selected} />
      </details>
      {maps.view.problem.value && <p class="hint">{maps.view.problem.value}</p>}
    </section>
  );
}

const BORDERS: [string, string][] = [
  ["plain", "Styles jump"],
  ["sharp", "Nothing crosses it"],
  ["soft", "Styles change gradually"],
];

function setBorder(store: Store, name: string, border: string): void {
  store.editDesign("Change a border", (design) => withRegion(design, name, { ...design.regions?.[name], border }));
}

/** The brush that corrects which pixels a region has. */
function Corrections({ store, of }: { store: Store; of: string }) {
  const here = correctionsHere(store).length;
  const correcting = store.tool.value === "correct";
  return (
    <>
      <button
        type="button"
        class="button small"
        aria-pressed={correcting}
        onClick={() => {
          store.tool.value = correcting ? "pan" : "correct";
        }}
      >
        <Icon name="brush" />
        Correct with a brush
      </button>
      {correcting && (
        <>
          <label class="style-slider">
            <span>Brush width</span>
            <input
              type="range"
              min={1}
              max={MAX_BRUSH_PX}
              value={store.brush.value.size}
              aria-label="Width of the correcting brush"
              onInput={(event) => store.resizeBrush(Number(event.currentTarget.value))}
            />
            <output>{store.brush.value.size} px</output>
          </label>
          <p class="hint">
            What you paint belongs to {of}, in the whole shot, along the motion. Alt gives it back to everything else.
          </p>
        </>
      )}
      {here > 0 && (
        <button type="button" class="button small" onClick={() => removeCorrections(store)}>
          <Icon name="trash" />
          Remove the corrections of this frame ({here})
        </button>
      )}
    </>
  );
}

function regionsHint(state: RegionsState, previews: boolean): string {
  if (state === "loading") return "Finding what moves together in this shot…";
  if (!previews || state === "missing")
    return "Draw a region on the stage with the lasso; draw it again in other frames. Shift adds a part.";
  const count = objectCount.value;
  const one = state === "ready" && count > 0 ? `one of the ${count} objects of this frame` : "an object on the stage";
  return `Pick ${one}: click it. Shift adds to the region, Alt makes the part of it under a click or a stroke a region of its own. A second click ends the selection. Or draw with the lasso.`;
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

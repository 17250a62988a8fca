/** Layers of a shot: order, visibility, opacity and blend; the topmost is listed first. */

import { useState } from "preact/hooks";
import { Icon, IconButton } from "../../ui/icons";
import { type Blend, changeShot, freeName, type Layer } from "../document/document";
import type { LayerMatte } from "../keys/matte";
import type { Store } from "../state/store";
import { LayerFiles, MarkMatte } from "./layer-files";

const BLENDS: [Blend, string][] = [
  ["over", "Normal"],
  ["multiply", "Multiply"],
  ["screen", "Screen"],
  ["add", "Add"],
];

export function LayersSection({ store, matte }: { store: Store; matte: LayerMatte }) {
  const { layers } = store.shot.value;
  const change = (label: string, to: (layers: readonly Layer[]) => Layer[], group = "") => {
    const { id } = store.shot.value;
    store.editDocument(
      label,
      (document) => changeShot(document, id, (shot) => ({ ...shot, layers: to(shot.layers) })),
      group,
    );
  };
  const add = () => {
    const id = freeName("layer", (candidate) => layers.some((layer) => layer.id === candidate));
    const unused = store.methods.find((method) => layers.every((layer) => layer.method !== method.name));
    const method = (unused ?? store.methods[0])?.name ?? store.layer.value.method;
    change("Add a layer", (all) => [...all, { id, method }]);
    select(store, id);
  };
  return (
    <section class="side-section" aria-labelledby="layers-title">
      <h2 id="layers-title">Layers of the shot</h2>
      {layers.length > 1 && <p class="hint">The film shows all visible layers, from the last to the first.</p>}
      <ul class="region-list" aria-label="Layers of the shot">
        {[...layers].reverse().map((layer) => (
          <LayerRow key={layer.id} store={store} matte={matte} layer={layer} change={change} />
        ))}
      </ul>
      <button type="button" class="button small" onClick={add}>
        <Icon name="plus" />
        Add a layer
      </button>
    </section>
  );
}

function select(store: Store, id: string): void {
  store.layerId.value = id;
  store.region.value = "";
  store.tool.value = "pan";
}

interface LayerRowProps {
  store: Store;
  matte: LayerMatte;
  layer: Layer;
  change(label: string, to: (layers: readonly Layer[]) => Layer[], group?: string): void;
}

function LayerRow({ store, matte, layer, change }: LayerRowProps) {
  const { layers } = store.shot.value;
  const [open, setOpen] = useState(false);
  const title = layer.name || store.methods.find((method) => method.name === layer.method)?.title || layer.method;
  const selected = store.layer.value.id === layer.id;
  const visible = layer.visible !== false;
  const edit = (label: string, to: Partial<Layer>, group = "") =>
    change(label, (all) => all.map((one) => (one.id === layer.id ? { ...one, ...to } : one)), group);
  const drop = () => {
    change("Remove a layer", (all) => all.filter((one) => one.id !== layer.id));
    if (selected) select(store, layers.find((one) => one.id !== layer.id)?.id ?? "");
  };
  const raise = () => change("Move a layer up", (all) => swapped(all, layer.id));
  const lower = () => {
    const below = layers[layers.findIndex((one) => one.id === layer.id) - 1];
    if (below) change("Move a layer down", (all) => swapped(all, below.id));
  };
  return (
    <li class="layer-row" aria-current={selected ? "true" : undefined}>
      <div>
        <IconButton
          name={visible ? "eye" : "hidden"}
          label={visible ? `Hide the layer ${title}` : `Show the layer ${title}`}
          onClick={() => edit(visible ? "Hide a layer" : "Show a layer", { visible: !visible })}
        />
        <button type="button" class="layer-name" aria-pressed={selected} onClick={() => select(store, layer.id)}>
          {title}
        </button>
        <IconButton
          name="next"
          label={`Settings of the layer ${title}`}
          pressed={open}
          onClick={() => setOpen(!open)}
        />
      </div>
      {open && (
        <div class="layer-settings">
          <label class="inline-field">
            Opacity
            <input
              type="range"
              min={0}
              max={100}
              value={100 * (layer.opacity ?? 1)}
              aria-label={`Opacity of the layer ${title}`}
              onInput={(event) =>
                edit(
                  "Change a layer's opacity",
                  { opacity: Number(event.currentTarget.value) / 100 },
                  `opacity-${layer.id}`,
                )
              }
            />
          </label>
          <label class="inline-field">
            Blend
            <select
              value={layer.blend ?? "over"}
              onChange={(event) => edit("Change the blend", { blend: event.currentTarget.value as Blend })}
            >
              {BLENDS.map(([blend, name]) => (
                <option key={blend} value={blend}>
                  {name}
                </option>
              ))}
            </select>
          </label>
          <LayerFiles store={store} layer={layer} />
          {store.previews.value && <MarkMatte store={store} matte={matte} layer={layer} />}
          <div class="actions">
            <button type="button" class="button small" disabled={layers.at(-1)?.id === layer.id} onClick={raise}>
              Move up
            </button>
            <button type="button" class="button small" disabled={layers[0]?.id === layer.id} onClick={lower}>
              Move down
            </button>
            <button type="button" class="button small" disabled={layers.length < 2} onClick={drop}>
              <Icon name="trash" />
              Remove
            </button>
          </div>
        </div>
      )}
    </li>
  );
}

/** The layers with one moved towards the front. */
export function swapped(layers: readonly Layer[], id: string): Layer[] {
  const index = layers.findIndex((layer) => layer.id === id);
  const above = layers[index + 1];
  const layer = layers[index];
  if (!above || !layer) return [...layers];
  return [...layers.slice(0, index), above, layer, ...layers.slice(index + 2)];
}

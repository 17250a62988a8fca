/** The layers of the shown key, topmost first: chosen, named, ordered, blended, merged. */

import { useEffect, useState } from "preact/hooks";
import { isAbort } from "../../api/api";
import { Icon, IconButton } from "../../ui/icons";
import { notify } from "../../ui/notices";
import { BLENDS, type PaintBlend } from "../drawing/blend";
import { changePictureLayer, type KeyPicture, type PictureLayer } from "../drawing/strokes";
import type { Store } from "../state/store";
import { FRAME_LAYER, LOOK_LAYER } from "./bases";
import type { KeyActions } from "./key-actions";
import type { PaintedKeys } from "./keys";
import * as edits from "./layer-edits";

interface LayersProps {
  store: Store;
  keys: PaintedKeys;
  actions: KeyActions;
}

/** The picture of the shown key, once it is open. */
function usePicture(store: Store, keys: PaintedKeys): KeyPicture | null {
  const frame = store.frame.value;
  const [loaded, setLoaded] = useState<KeyPicture | null>(null);
  const layerId = store.layerId.value;
  useEffect(() => {
    let current = true;
    setLoaded(null);
    keys
      .open(frame, () => current && store.frame.peek() === frame)
      .then((found) => current && setLoaded(found))
      .catch((error) => isAbort(error) || notify(error));
    return () => {
      current = false;
    };
  }, [frame, layerId]);
  return keys.picture(frame) ?? loaded;
}

export function PictureLayers({ store, keys, actions }: LayersProps) {
  const frame = store.frame.value;
  const picture = usePicture(store, keys);
  const [dragged, setDragged] = useState("");
  if (!picture) return null;
  const { layers, mask } = picture;
  const id = store.paintLayer.value;
  const chosen =
    (id === edits.MASK ? mask : layers.find((layer) => layer.id === id)) ?? layers.findLast(({ group }) => !group);
  const edit = (label: string, next: KeyPicture) => next !== picture && keys.edit(label, frame, next);
  const change = (label: string, layer: PictureLayer, to: Partial<PictureLayer>) =>
    edit(
      label,
      changePictureLayer(picture, layer.id, (one) => ({ ...one, ...to })),
    );
  const add = () => {
    const number = layers.filter(({ group }) => !group).length;
    const layer = edits.emptyLayer(edits.freeId(picture, `paint-${number}`), `Paint ${number}`, null);
    edit("Add a layer", edits.addLayer(picture, layer, chosen?.id ?? ""));
    store.paintLayer.value = layer.id;
  };
  const drop = (target: string, where: "above" | "below" | "inside") => {
    edit("Move a layer", edits.moveLayer(picture, dragged, target, where));
    setDragged("");
  };
  return (
    <>
      <ul class="picture-layers" aria-label="Layers of this key">
        {mask && <LayerRow store={store} layer={mask} chosen={chosen === mask} depth={0} change={change} />}
        {[...layers].reverse().map((layer) => (
          <LayerRow
            key={layer.id}
            store={store}
            layer={layer}
            chosen={layer === chosen}
            depth={edits.depthOf(layers, layer)}
            change={change}
            move={(by) => edit("Move a layer", edits.moveLayerBy(picture, layer.id, by))}
            drag={{ start: () => setDragged(layer.id), active: dragged !== "" && dragged !== layer.id, drop }}
          />
        ))}
      </ul>
      {chosen && chosen !== mask && (
        <LayerSettings layer={chosen} lowest={layers[0] === chosen} change={(label, to) => change(label, chosen, to)} />
      )}
      <div class="actions">
        <button type="button" class="button small" onClick={add}>
          <Icon name="plus" />
          Layer
        </button>
        {chosen && chosen !== mask && (
          <LayerButtons picture={picture} layer={chosen} edit={edit} merge={() => actions.merge(frame, chosen.id)} />
        )}
        {chosen && chosen === mask && (
          <IconButton
            name="trash"
            label="Remove the mask"
            onClick={() => {
              const { mask: _mask, ...rest } = picture;
              edit("Remove the mask", rest);
            }}
          />
        )}
      </div>
      <div class="actions">
        <BaseChoice layers={layers} choose={(kind) => actions.setBase(frame, kind).catch(notify)} />
        {!mask && (
          <button
            type="button"
            class="button small"
            title="Erase what the method is to paint; the key counts where the mask has paint"
            onClick={() => {
              edit("Add a mask", { ...picture, mask: edits.fullMask(store.size) });
              store.paintLayer.value = edits.MASK;
              store.tool.value = "eraser";
            }}
          >
            Mask of the key
          </button>
        )}
      </div>
    </>
  );
}

type BaseKind = "look" | "frame" | "none";

/** What lies below the paint. */
function BaseChoice({ layers, choose }: { layers: readonly PictureLayer[]; choose(kind: BaseKind): void }) {
  const [lowest] = layers;
  const kind = lowest?.id === FRAME_LAYER ? "frame" : lowest?.id === LOOK_LAYER ? "look" : "none";
  return (
    <label class="inline-field">
      Below the paint
      <select value={kind} onChange={(event) => choose(event.currentTarget.value as BaseKind)}>
        <option value="look">Painted frame</option>
        <option value="frame">Video frame</option>
        <option value="none">Nothing</option>
      </select>
    </label>
  );
}

interface LayerButtonsProps {
  picture: KeyPicture;
  layer: PictureLayer;
  edit(label: string, next: KeyPicture): void;
  merge(): Promise<void>;
}

function LayerButtons({ picture, layer, edit, merge }: LayerButtonsProps) {
  const { id, group } = layer;
  const remove = edits.removeLayer(picture, id);
  return (
    <>
      {!group && (
        <IconButton
          name="copy"
          label="Duplicate the layer"
          onClick={() => edit("Duplicate a layer", edits.duplicateLayer(picture, id))}
        />
      )}
      <button
        type="button"
        class="button small"
        onClick={() =>
          group ? edit("Ungroup", edits.ungroup(picture, id)) : edit("Group a layer", edits.groupLayer(picture, id))
        }
      >
        {group ? "Ungroup" : "Group"}
      </button>
      <button
        type="button"
        class="button small"
        disabled={!edits.mergedOnto(picture, id)}
        onClick={() => merge().catch(notify)}
      >
        {group ? "Merge the group" : "Merge down"}
      </button>
      <IconButton
        name="trash"
        label={group ? "Remove the group" : "Remove the layer"}
        disabled={remove === picture}
        onClick={() => edit(group ? "Remove a group" : "Remove a layer", remove)}
      />
    </>
  );
}

interface LayerSettingsProps {
  layer: PictureLayer;
  lowest: boolean;
  change(label: string, to: Partial<PictureLayer>): void;
}

/** Blend mode, clipping and lock of the chosen layer. */
function LayerSettings({ layer, lowest, change }: LayerSettingsProps) {
  const modes: readonly (readonly [PaintBlend, string])[] = [
    ...(layer.group ? [["pass-through", "Pass through"] as const] : []),
    ...BLENDS,
    ...(layer.blend === "add" ? [["add", "Add"] as const] : []),
  ];
  return (
    <div class="layer-settings">
      <label class="inline-field">
        Blend
        <select
          aria-label={`Blend of ${layer.name}`}
          value={layer.blend ?? "over"}
          onChange={(event) => change("Change a layer's blend", { blend: event.currentTarget.value as PaintBlend })}
        >
          {modes.map(([blend, title]) => (
            <option key={blend} value={blend}>
              {title}
            </option>
          ))}
        </select>
      </label>
      <label class="check-field" title="Visible only where the layer below it is">
        <input
          type="checkbox"
          checked={layer.clip ?? false}
          disabled={lowest}
          onChange={(event) => change("Clip a layer", { clip: event.currentTarget.checked })}
        />
        Clip to the layer below
      </label>
      {!layer.group && (
        <label class="check-field" title="Strokes change colours only, not where the layer has paint">
          <input
            type="checkbox"
            checked={layer.locked ?? false}
            onChange={(event) => change("Lock a layer's opacity", { locked: event.currentTarget.checked })}
          />
          Lock transparency
        </label>
      )}
      {layer.mask && (
        <button type="button" class="button small" onClick={() => change("Remove a layer's mask", { mask: null })}>
          Remove the layer's mask
        </button>
      )}
    </div>
  );
}

interface LayerRowProps {
  store: Store;
  layer: PictureLayer;
  chosen: boolean;
  /** In groups, from 0. */
  depth: number;
  change(label: string, layer: PictureLayer, to: Partial<PictureLayer>): void;
  move?(by: 1 | -1): void;
  drag?: { start(): void; active: boolean; drop(target: string, where: "above" | "below" | "inside"): void };
}

function LayerRow({ store, layer, chosen, depth, change, move, drag }: LayerRowProps) {
  const [naming, setNaming] = useState(false);
  const choose = () => {
    store.paintLayer.value = layer.id;
  };
  const rename = (event: Event) => {
    const name = (event.currentTarget as HTMLInputElement).value.trim();
    if (name && name !== layer.name) change("Rename a layer", layer, { name: name.slice(0, 200) });
    setNaming(false);
  };
  const keys = (event: KeyboardEvent) => {
    const by = event.altKey && { ArrowUp: 1 as const, ArrowDown: -1 as const }[event.key];
    if (by) move?.(by);
    else if (event.key === "F2") setNaming(true);
    else return;
    event.preventDefault();
    event.stopPropagation();
  };
  /** The list is topmost first; the middle of a group's row is inside of it. */
  const where = (event: DragEvent) => {
    const box = (event.currentTarget as HTMLElement).getBoundingClientRect();
    const share = (event.clientY - box.top) / box.height;
    if (layer.group && share > 0.25 && share < 0.75) return "inside";
    return share < 0.5 ? "above" : "below";
  };
  return (
    <li
      aria-current={chosen ? "true" : undefined}
      class={layer.clip ? "clipped" : undefined}
      style={{ paddingInlineStart: `${depth}rem` }}
      draggable={Boolean(drag) && !naming}
      onDragStart={(event) => {
        event.dataTransfer?.setData("text/plain", layer.name);
        drag?.start();
      }}
      onDragOver={(event) => drag?.active && event.preventDefault()}
      onDrop={(event) => {
        if (!drag?.active) return;
        event.preventDefault();
        event.stopPropagation();
        drag.drop(layer.id, where(event));
      }}
    >
      {drag && (
        <IconButton
          name={layer.visible ? "eye" : "hidden"}
          label={layer.visible ? `Hide ${layer.name}` : `Show ${layer.name}`}
          onClick={() => change(layer.visible ? "Hide a layer" : "Show a layer", layer, { visible: !layer.visible })}
        />
      )}
      {naming ? (
        <input
          type="text"
          class="layer-name"
          aria-label={`Name of ${layer.name}`}
          maxLength={200}
          ref={(input) => input?.focus()}
          value={layer.name}
          onBlur={rename}
          onKeyDown={(event) => {
            if (event.key === "Enter") rename(event);
            if (event.key === "Escape") setNaming(false);
          }}
        />
      ) : (
        <button
          type="button"
          class="layer-name"
          aria-pressed={chosen}
          title="Double-click or F2: rename. Drag, or Alt with the arrow keys: move."
          onClick={choose}
          onDblClick={() => setNaming(true)}
          onKeyDown={keys}
        >
          {layer.group && <Icon name="film" />}
          {layer.name}
        </button>
      )}
      {drag && (
        <input
          type="range"
          min={0}
          max={100}
          value={100 * layer.opacity}
          aria-label={`Opacity of ${layer.name}`}
          onChange={(event) =>
            change("Change a layer's opacity", layer, { opacity: Number(event.currentTarget.value) / 100 })
          }
        />
      )}
    </li>
  );
}

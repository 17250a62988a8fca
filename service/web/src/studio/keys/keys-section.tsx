/** Painted keys of a layer: start one, import or export a picture, its layers, and the frames around it. */

import { useEffect, useRef, useState } from "preact/hooks";
import { isAbort, saveFile } from "../../api/api";
import type { Section } from "../../api/schemas";
import { Icon, IconButton } from "../../ui/icons";
import { notify, notifyOf } from "../../ui/notices";
import { changePictureLayer, type KeyPicture, type PictureLayer } from "../drawing/strokes";
import { type FilmFrame, filmHas } from "../films/films";
import { paintedFrames } from "../films/filmstrip";
import type { Result, Store } from "../state/store";
import type { PaintedKeys } from "./keys";
import { isPsd, makePsd, readLayers } from "./psd";

export interface KeysSectionProps {
  store: Store;
  section: Section;
  keys: PaintedKeys;
  /** Make the present painting of the shown frame a key. */
  correct(): Promise<void>;
  /** Make a frame of a finished film a key. */
  take(frame: FilmFrame): Promise<void>;
  /** Find frames that are worth a key. */
  suggest(): Promise<void>;
}

export function KeysSection({ store, section, keys, correct, take, suggest }: KeysSectionProps) {
  const [waiting, setWaiting] = useState(false);
  const frame = store.frame.value;
  const frames = paintedFrames(store, [section]);
  const here = frames.includes(frame);
  const film = store.film.value;
  const paint = () => {
    store.tool.value = "brush";
  };
  const takeResult = () => {
    setWaiting(true);
    correct()
      .catch(notify)
      .finally(() => setWaiting(false));
  };
  return (
    <section class="side-section" onClickCapture={() => store.paint(section)} aria-labelledby={`${section.part}-title`}>
      <h2 id={`${section.part}-title`}>{section.title}</h2>
      {!frames.length && (
        <p class="hint">Paint over a frame: the film follows your painting from there, forwards and backwards.</p>
      )}
      <div class="actions">
        <button type="button" class="button primary" onClick={paint}>
          <Icon name="brush" />
          {here ? "Paint on this key" : `Paint frame ${frame + 1}`}
        </button>
        {!here && frames.length > 0 && store.previews.value && (
          <button
            type="button"
            class="button small"
            disabled={waiting}
            title="The frame as it is painted now becomes a key, for you to paint over"
            onClick={takeResult}
          >
            <Icon name="brush" />
            {waiting ? "Painting it…" : "Correct this frame"}
          </button>
        )}
        {!here && film && filmHas(store, frame) && (
          <button
            type="button"
            class="button small"
            title="The frame of the newest finished film becomes a key, for you to paint over"
            onClick={() => take({ film: film.id, frame }).catch(notify)}
          >
            <Icon name="film" />
            Correct the film's frame
          </button>
        )}
        <ImportButton store={store} keys={keys} />
        <button type="button" class="button small" onClick={() => exportFrame(store, keys)}>
          <Icon name="download" />
          Export PNG
        </button>
        <button
          type="button"
          class="button small"
          title="With its layers, for other painting programs"
          onClick={() => exportPsd(store, keys).catch(notify)}
        >
          <Icon name="download" />
          Export PSD
        </button>
        {here && <IconButton name="trash" label="Remove this key" onClick={() => keys.remove(frame, section)} />}
      </div>
      {store.previews.value && <Suggestions store={store} known={frames} suggest={suggest} />}
      {here && <PictureLayers store={store} keys={keys} />}
      <Neighbours store={store} />
    </section>
  );
}

interface SuggestionsProps {
  store: Store;
  /** Frames that have a key. */
  known: readonly number[];
  suggest(): Promise<void>;
}

/** Frames that are worth a key: after cuts, and where much has changed since the last one. */
function Suggestions({ store, known, suggest }: SuggestionsProps) {
  const [waiting, setWaiting] = useState(false);
  const open = store.suggested.value.filter((frame) => !known.includes(frame));
  const ask = () => {
    setWaiting(true);
    suggest()
      .catch(notify)
      .finally(() => setWaiting(false));
  };
  return (
    <div class="suggestions">
      <button type="button" class="button small" disabled={waiting} onClick={ask}>
        <Icon name="key" />
        {waiting ? "Comparing the frames…" : "Suggest keys"}
      </button>
      {open.length > 0 && (
        <div class="chips" role="group" aria-label="Suggested keys">
          {open.map((frame) => (
            <button key={frame} type="button" class="chip-button" onClick={() => store.goTo(frame)}>
              Frame {frame + 1}
            </button>
          ))}
        </div>
      )}
    </div>
  );
}

function ImportButton({ store, keys }: { store: Store; keys: PaintedKeys }) {
  const take = (event: Event) => {
    const input = event.currentTarget as HTMLInputElement;
    const file = input.files?.[0];
    if (file) importKey(store, keys, file).catch(notify);
    input.value = "";
  };
  return (
    <label class="button small file-button">
      <Icon name="upload" />
      Import PNG, PSD
      <input type="file" accept="image/png,image/*,.psd" aria-label="Import a painted frame" onChange={take} />
    </label>
  );
}

/** A picture becomes one layer; a PSD keeps its layers. */
async function importKey(store: Store, keys: PaintedKeys, file: File): Promise<void> {
  const frame = store.frame.value;
  const key = store.pictureKey(frame);
  if (!isPsd(file)) return keys.import(frame, file);
  const { layers, simplified } = await readLayers(file, store.size);
  await keys.importLayers(frame, layers, key);
  if (!simplified.length) return;
  const names = simplified.map((name) => `“${name}”`).join(", ");
  notifyOf({
    title: "Some layers look different here",
    message: `Blend modes, masks and effects are not kept: ${names}.`,
    remedy: "Merge these layers in the other program, and import the file again.",
  });
}

const fileName = (store: Store, suffix: string): string =>
  `${store.document.value.name}-frame-${String(store.frame.value).padStart(5, "0")}.${suffix}`;

async function exportPsd(store: Store, keys: PaintedKeys): Promise<void> {
  const name = fileName(store, "psd");
  const { layers, whole } = await keys.layersOf(store.frame.value);
  saveFile(await makePsd(store.size, layers, whole), name);
}

function exportFrame(store: Store, keys: PaintedKeys): void {
  const frame = store.frame.value;
  const name = fileName(store, "png");
  keys.png(frame).then((blob) => saveFile(blob, name), notify);
}

/** The layers of the shown key, topmost first. */
function PictureLayers({ store, keys }: { store: Store; keys: PaintedKeys }) {
  const frame = store.frame.value;
  const [loaded, setLoaded] = useState<KeyPicture | null>(null);
  const picture = keys.picture(frame) ?? loaded;
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
  if (!picture) return null;
  const change = (label: string, id: string, to: Partial<PictureLayer>) =>
    keys.edit(
      label,
      frame,
      changePictureLayer(picture, id, (layer) => ({ ...layer, ...to })),
    );
  const add = () => {
    const id = `paint-${picture.layers.length}`;
    const layer: PictureLayer = {
      id,
      name: `Paint ${picture.layers.length}`,
      opacity: 1,
      visible: true,
      base: null,
      strokes: [],
    };
    keys.edit("Add a layer", frame, { layers: [...picture.layers, layer] });
    store.paintLayer.value = id;
  };
  return (
    <ul class="picture-layers" aria-label="Layers of this key">
      {[...picture.layers].reverse().map((layer) => (
        <LayerRow key={layer.id} store={store} layer={layer} change={(label, to) => change(label, layer.id, to)} />
      ))}
      <li>
        <button type="button" class="button small" onClick={add}>
          <Icon name="plus" />
          Layer
        </button>
      </li>
    </ul>
  );
}

interface LayerRowProps {
  store: Store;
  layer: PictureLayer;
  change(label: string, to: Partial<PictureLayer>): void;
}

function LayerRow({ store, layer, change }: LayerRowProps) {
  const choose = () => {
    store.paintLayer.value = layer.id;
  };
  return (
    <li aria-current={store.paintLayer.value === layer.id ? "true" : undefined}>
      <IconButton
        name={layer.visible ? "eye" : "hidden"}
        label={layer.visible ? `Hide ${layer.name}` : `Show ${layer.name}`}
        onClick={() => change(layer.visible ? "Hide a layer" : "Show a layer", { visible: !layer.visible })}
      />
      <button type="button" class="layer-name" aria-pressed={store.paintLayer.value === layer.id} onClick={choose}>
        {layer.name}
      </button>
      <input
        type="range"
        min={0}
        max={100}
        value={100 * layer.opacity}
        aria-label={`Opacity of ${layer.name}`}
        onChange={(event) => change("Change a layer's opacity", { opacity: Number(event.currentTarget.value) / 100 })}
      />
    </li>
  );
}

/** The frames around the key, repainted from it. */
function Neighbours({ store }: { store: Store }) {
  const results = store.neighbours.value;
  if (!results.length) return null;
  return (
    <div class="neighbours" role="group" aria-label="Frames painted from this key">
      {results.map((result) => (
        <button
          key={result.frame}
          type="button"
          aria-label={`Frame ${result.frame + 1}`}
          onClick={() => store.goTo(result.frame)}
        >
          <ResultPicture result={result} />
          <span>{result.frame + 1}</span>
        </button>
      ))}
    </div>
  );
}

function ResultPicture({ result }: { result: Result }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    const { picture } = result;
    const element = canvas.current;
    if (!element) return;
    Object.assign(element, { width: picture.width, height: picture.height });
    element.getContext("2d")?.drawImage(picture, 0, 0);
  }, [result]);
  return <canvas ref={canvas} />;
}

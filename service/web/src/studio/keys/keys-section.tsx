/** Painted keys of a layer: start one, import or export a picture, its layers, and the frames around it. */

import { useEffect, useRef, useState } from "preact/hooks";
import type { Section } from "../../api/schemas";
import { Icon, IconButton } from "../../ui/icons";
import { notify } from "../../ui/notices";
import { type PaintedKey, picturesOf } from "../document/document";
import { type FilmFrame, filmHas } from "../films/films";
import { paintedFrames } from "../films/key-marks";
import type { Result, Store } from "../state/store";
import { type KeyActions, readCopied } from "./key-actions";
import type { PaintedKeys } from "./keys";
import { PictureLayers } from "./picture-layers";

export interface KeysSectionProps {
  store: Store;
  section: Section;
  keys: PaintedKeys;
  /** Make the present painting of the shown frame a key. */
  correct(): Promise<void>;
  /** Make a frame of a finished film a key. */
  take(frame: FilmFrame): Promise<void>;
  actions: KeyActions;
  /** Find frames that are worth a key. */
  suggest(): Promise<void>;
}

export function KeysSection({ store, section, keys, correct, take, actions, suggest }: KeysSectionProps) {
  const [waiting, setWaiting] = useState(false);
  const [copied, setCopied] = useState(false);
  const frame = store.frame.value;
  const frames = paintedFrames(store, [section]);
  const here = frames.includes(frame);
  const film = store.film.value;
  const entry = picturesOf<PaintedKey>(store.layer.value, section.part).find((one) => one.frame === frame);
  const paint = () => {
    store.tool.value = "brush";
  };
  const copy = () => {
    actions
      .copy(frame)
      .then(() => setCopied(true))
      .catch(notify);
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
        <ImportButton store={store} actions={actions} />
        <Exports frame={frame} frames={frames} actions={actions} />
        {here && <IconButton name="copy" label="Copy this key" keys="Ctrl+C" onClick={copy} />}
        {(copied || readCopied()) && (
          <button type="button" class="button small" onClick={() => actions.paste(frame).catch(notify)}>
            <Icon name="copy" />
            Paste the copied key
          </button>
        )}
        {here && <IconButton name="trash" label="Remove this key" onClick={() => keys.remove(frame, section)} />}
      </div>
      {store.previews.value && <Suggestions store={store} known={frames} suggest={suggest} />}
      {here && (
        <>
          <PictureLayers store={store} keys={keys} actions={actions} />
          {store.method.value?.inputs.some(({ kind, part }) => kind === "json" && part === section.part) && (
            <Reach frame={frame} entry={entry} actions={actions} />
          )}
        </>
      )}
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

function ImportButton({ store, actions }: { store: Store; actions: KeyActions }) {
  const take = (event: Event) => {
    const input = event.currentTarget as HTMLInputElement;
    const file = input.files?.[0];
    if (file) actions.import(store.frame.value, file).catch(notify);
    input.value = "";
  };
  return (
    <label class="button small file-button" title="Or drop it anywhere on the page, or paste it">
      <Icon name="upload" />
      Import PNG, PSD
      <input type="file" accept="image/png,image/*,.psd" aria-label="Import a painted frame" onChange={take} />
    </label>
  );
}

interface ExportProps {
  frame: number;
  /** Frames that have a key. */
  frames: readonly number[];
  actions: KeyActions;
}

function Exports({ frame, frames, actions }: ExportProps) {
  return (
    <>
      <button type="button" class="button small" onClick={() => actions.exportPng(frame).catch(notify)}>
        <Icon name="download" />
        Export PNG
      </button>
      <button
        type="button"
        class="button small"
        title="With its layers, for other painting programs"
        onClick={() => actions.exportPsd(frame).catch(notify)}
      >
        <Icon name="download" />
        Export PSD
      </button>
      {frames.length > 1 &&
        (["png", "psd"] as const).map((kind) => (
          <button
            key={kind}
            type="button"
            class="button small"
            title="In one zip file, named by frame number"
            onClick={() => actions.exportAll(frames, kind).catch(notify)}
          >
            <Icon name="download" />
            All keys as {kind.toUpperCase()}
          </button>
        ))}
    </>
  );
}

/** How far the shown key reaches, and its weight against its neighbours. */
function Reach({ frame, entry, actions }: { frame: number; entry: PaintedKey | undefined; actions: KeyActions }) {
  const weight = entry?.weight ?? 1;
  const frames = (side: "before" | "after", title: string) => (
    <label class="inline-field">
      {title}
      <input
        type="number"
        min={0}
        max={10_000_000}
        placeholder="next key"
        disabled={!entry}
        value={entry?.[side] ?? ""}
        onChange={(event) => {
          const { value, valueAsNumber } = event.currentTarget;
          actions.set(frame, { [side]: value === "" ? null : Math.max(0, Math.round(valueAsNumber)) }, "");
        }}
      />
    </label>
  );
  return (
    <div class="key-reach" role="group" aria-label="Reach of this key">
      {frames("before", "Frames before it")}
      {frames("after", "Frames after it")}
      <label class="inline-field" title="Between two keys, what each determines relates as their weights">
        Weight
        <input
          type="range"
          min={-1}
          max={1}
          step={0.01}
          disabled={!entry}
          value={Math.log10(weight)}
          aria-valuetext={String(weight)}
          onInput={(event) => actions.set(frame, { weight: weightOf(event.currentTarget.valueAsNumber) })}
        />
        <output>{weight}</output>
      </label>
    </div>
  );
}

/** 0.1 to 10, with two digits. */
const weightOf = (logarithm: number): number => Number((10 ** logarithm).toPrecision(2));

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

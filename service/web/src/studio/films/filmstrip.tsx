/** The filmstrip: thumbnails, the playhead, marks of keys, and the buttons to step through the frames. */

import type { ComponentChildren } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import * as api from "../../api/api";
import type { Section } from "../../api/schemas";
import { IconButton } from "../../ui/icons";
import { picturesOf } from "../document/document";
import type { Cuts } from "../previews/cuts";
import { isPainted, pictureAt, type Store } from "../state/store";
import {
  frameAt,
  isShown,
  nextKey,
  previousKey,
  shareOf,
  shiftSpan,
  shotAt,
  shotStarts,
  thumbnailFrames,
  timeCode,
  zoomSpan,
} from "../state/timeline";
import type { Playback } from "./playback";

const THUMBNAIL_PX = 104;
const THUMBNAIL_SIDE_PX = 160;
const BUSY_MS = 800;
/** Thumbnails are loaded once the strip has shown the same frames for so long. */
const THUMBNAIL_REST_MS = 200;
/** Zoom of a wheel's step of one px; px of a step along the strip that shift it by all that it shows. */
const WHEEL_ZOOM = 1.002;
const WHEEL_PX = 1000;
/** A shorter video needs no zoom of the strip. */
const ZOOM_FRAMES = 240;

/** Frames that are painted in the parts of these sections of the selected layer. */
export function paintedFrames(store: Store, sections: readonly Section[]): number[] {
  const layer = store.layer.value;
  const stored = sections.flatMap(({ part }) => picturesOf(layer, part)).map(({ frame }) => frame);
  const open = Object.keys(store.history.value.present.pictures)
    .map(pictureAt)
    .filter((at) => at.layer === layer.id && sections.some(({ part }) => part === at.part));
  return [...new Set([...stored, ...open.map(({ frame }) => frame)])].sort((a, b) => a - b);
}

/** Frames with a key of the selected layer: painted, or of style and direction of the selected region. */
export function keyFrames(store: Store): number[] {
  const { keys = [], directions = [] } = store.design;
  const tracks = [...keys, ...directions].filter((key) => !store.region.value || key.region === store.region.value);
  const painted = paintedFrames(store, store.method.value?.studio.sections.filter(isPainted) ?? []);
  return [...new Set([...painted, ...tracks.map(({ frame }) => frame)])].sort((a, b) => a - b);
}

interface FilmstripProps {
  store: Store;
  playback: Playback;
  cuts: Cuts;
  /** Shown below the strip, frame by frame. */
  lane?: ComponentChildren;
}

export function Filmstrip({ store, playback, cuts, lane }: FilmstripProps) {
  const strip = useRef<HTMLDivElement>(null);
  const count = useColumns(strip);
  const { frames } = store;
  const span = store.span.value;
  const shown = useRested(thumbnailFrames(count, span), THUMBNAIL_REST_MS);
  const under = (event: MouseEvent) => {
    const box = strip.current?.getBoundingClientRect();
    return box ? frameAt(event.clientX - box.left, box.width, span) : store.frame.value;
  };
  const scrub = (event: PointerEvent) => store.goTo(under(event));
  const wheel = (event: WheelEvent) => {
    event.preventDefault();
    const [across, along] = [event.deltaY, event.deltaX];
    store.span.value =
      Math.abs(along) > Math.abs(across)
        ? shiftSpan(span, frames, (along / WHEEL_PX) * (span[1] - span[0]))
        : zoomSpan(span, frames, WHEEL_ZOOM ** across, under(event));
  };
  return (
    <div class="filmstrip">
      <Transport store={store} playback={playback} cuts={cuts} />
      <div
        class="strip"
        ref={strip}
        role="slider"
        tabIndex={0}
        aria-label="Frame"
        aria-valuemin={1}
        aria-valuemax={frames}
        aria-valuenow={store.frame.value + 1}
        aria-valuetext={`Frame ${store.frame.value + 1} of ${frames}${shotText(store)}`}
        onDragStart={(event) => event.preventDefault()}
        onPointerDown={(event) => {
          if (event.button !== 0) return;
          event.preventDefault(); // no selection: the next drag would move it instead of the playhead
          event.currentTarget.focus({ preventScroll: true });
          playback.stop();
          event.currentTarget.setPointerCapture(event.pointerId);
          scrub(event);
        }}
        onWheel={wheel}
        onPointerMove={(event) => event.currentTarget.hasPointerCapture(event.pointerId) && scrub(event)}
        onKeyDown={(event) => {
          if (event.key === "+" || event.key === "-") {
            event.preventDefault();
            event.stopPropagation();
            zoomStrip(store, event.key === "+" ? 0.5 : 2);
            return;
          }
          const by = { ArrowLeft: -1, ArrowRight: 1, PageUp: 10, PageDown: -10 }[event.key];
          if (!by) return;
          event.preventDefault();
          event.stopPropagation();
          store.goTo(store.frame.value + by);
        }}
      >
        <Thumbnails assetId={store.asset.id} shown={shown} />
        {store.cuts.value
          .filter((cut) => isShown(cut, span))
          .map((cut) => (
            <div key={cut} class="cut-mark" style={{ left: `${100 * shareOf(cut, span)}%` }} />
          ))}
        <div class="playhead" style={{ left: `${100 * shareOf(store.frame.value + 0.5, span)}%` }} />
      </div>
      {lane}
      <KeyMarks store={store} />
    </div>
  );
}

/** Show `factor` times as many frames, the playhead in its place. */
function zoomStrip(store: Store, factor: number): void {
  const { span, frame, frames } = store;
  const about = isShown(frame.value, span.value) ? frame.value : (span.value[0] + span.value[1]) / 2;
  span.value = zoomSpan(span.value, frames, factor, about);
}

/** ", shot 2 of 5"; empty while no cut is known. */
function shotText({ cuts, frame }: Store): string {
  const known = cuts.value;
  return known.length ? `, shot ${shotAt(known, frame.value)} of ${known.length + 1}` : "";
}

/** A list of numbers, once it has been the same for `ms`. */
function useRested(value: number[], ms: number): number[] {
  const [rested, setRested] = useState(value);
  const key = value.join();
  useEffect(() => {
    const timer = setTimeout(() => setRested(value), ms);
    return () => clearTimeout(timer);
  }, [key]);
  return rested;
}

/** As many thumbnails as fit side by side. */
function useColumns(host: { current: HTMLElement | null }): number {
  const [count, setCount] = useState(1);
  useEffect(() => {
    const element = host.current;
    if (!element) return;
    const observer = new ResizeObserver(() => setCount(Math.max(1, Math.round(element.clientWidth / THUMBNAIL_PX))));
    observer.observe(element);
    return () => observer.disconnect();
  }, []);
  return count;
}

function Thumbnails({ assetId, shown }: { assetId: string; shown: number[] }) {
  const [pictures, setPictures] = useState<ReadonlyMap<number, string>>(new Map());
  const key = shown.join();
  useEffect(() => {
    const controller = new AbortController();
    const urls: string[] = [];
    setPictures(new Map()); // those of other columns are revoked
    const load = async () => {
      for (const frame of shown) {
        const url = await thumbnail(assetId, frame, controller.signal);
        if (!url || controller.signal.aborted) return;
        urls.push(url);
        setPictures((known) => new Map(known).set(frame, url));
      }
    };
    load();
    return () => {
      controller.abort();
      for (const url of urls) URL.revokeObjectURL(url);
    };
  }, [assetId, key]);
  return (
    <div class="thumbnails" aria-hidden="true">
      {shown.map((frame) => (
        <span key={frame}>{pictures.has(frame) && <img src={pictures.get(frame)} alt="" draggable={false} />}</span>
      ))}
    </div>
  );
}

/** A thumbnail's object URL; tried again while the service decodes for others; empty if it is not to be had. */
export async function thumbnail(assetId: string, frame: number, signal: AbortSignal): Promise<string> {
  for (;;) {
    try {
      return await api.objectUrl(api.paths.frame(assetId, frame, THUMBNAIL_SIDE_PX), signal);
    } catch (error) {
      const busy = error instanceof api.Problem && error.status === 503;
      if (!busy || signal.aborted) return "";
      await new Promise((done) => setTimeout(done, BUSY_MS));
    }
  }
}

function KeyMarks({ store }: { store: Store }) {
  const span = store.span.value;
  const marks = keyFrames(store).filter((frame) => isShown(frame, span));
  const suggested = store.suggested.value.filter((frame) => isShown(frame, span) && !marks.includes(frame));
  return (
    <div class="key-marks" role="group" aria-label="Keys">
      {marks.map((frame) => (
        <button
          key={frame}
          type="button"
          class="key-mark"
          aria-label={`Key at frame ${frame + 1}`}
          aria-current={frame === store.frame.value ? "true" : undefined}
          title={`Key at frame ${frame + 1}`}
          style={{ left: `${100 * shareOf(frame + 0.5, span)}%` }}
          onClick={() => store.goTo(frame)}
        />
      ))}
      {suggested.map((frame) => (
        <button
          key={`suggested-${frame}`}
          type="button"
          class="key-mark suggested"
          aria-label={`Suggested key at frame ${frame + 1}`}
          title={`Suggested key at frame ${frame + 1}`}
          style={{ left: `${100 * shareOf(frame + 0.5, span)}%` }}
          onClick={() => store.goTo(frame)}
        />
      ))}
    </div>
  );
}

/** Steps between shots; where the video is long, the button that finds them. */
function ShotButtons({ store, cuts, step }: { store: Store; cuts: Cuts; step(to: number | undefined): void }) {
  const frame = store.frame.value;
  const starts = shotStarts(store.cuts.value);
  const done = cuts.done.value;
  return (
    <>
      {starts.length > 1 && (
        <>
          <IconButton
            name="previousShot"
            label="Previous shot"
            keys=","
            disabled={previousKey(starts, frame) === undefined}
            onClick={() => step(previousKey(starts, frame))}
          />
          <IconButton
            name="nextShot"
            label="Next shot"
            keys="."
            disabled={nextKey(starts, frame) === undefined}
            onClick={() => step(nextKey(starts, frame))}
          />
        </>
      )}
      {store.previews.value && cuts.asked && !cuts.known.value && (
        <button type="button" class="button small quiet" disabled={done !== null} onClick={cuts.find}>
          {done === null ? "Find the cuts" : `Finding the cuts, ${Math.round(100 * done)} %`}
        </button>
      )}
    </>
  );
}

function Transport({ store, playback, cuts }: { store: Store; playback: Playback; cuts: Cuts }) {
  const keys = keyFrames(store);
  const frame = store.frame.value;
  const step = (to: number | undefined) => {
    playback.stop();
    if (to !== undefined) store.goTo(to);
  };
  const speed = playback.speed.value;
  return (
    <div class="strip-transport">
      <IconButton
        name="first"
        label="Previous key"
        disabled={previousKey(keys, frame) === undefined}
        onClick={() => step(previousKey(keys, frame))}
      />
      <IconButton name="back" label="Previous frame" keys="Left" onClick={() => step(frame - 1)} />
      <IconButton
        name={speed ? "pause" : "play"}
        label={speed ? "Pause" : "Play"}
        keys="Space"
        onClick={playback.toggle}
      />
      <IconButton name="next" label="Next frame" keys="Right" onClick={() => step(frame + 1)} />
      <IconButton
        name="last"
        label="Next key"
        disabled={nextKey(keys, frame) === undefined}
        onClick={() => step(nextKey(keys, frame))}
      />
      <ShotButtons store={store} cuts={cuts} step={step} />
      {store.frames > ZOOM_FRAMES && (
        <div class="strip-zoom">
          <IconButton
            name="zoom"
            label="Fewer frames on the filmstrip"
            keys="+ on the filmstrip"
            onClick={() => zoomStrip(store, 0.5)}
          />
          <IconButton
            name="zoomOut"
            label="More frames on the filmstrip"
            keys="- on the filmstrip"
            disabled={store.span.value[1] - store.span.value[0] >= store.frames}
            onClick={() => zoomStrip(store, 2)}
          />
        </div>
      )}
      <output class="strip-time" aria-label="Position">
        <span>
          Frame {frame + 1} of {store.frames}
          {shotText(store)}
        </span>
        <span>{timeCode(frame, store.fps)}</span>
        {speed !== 0 && speed !== 1 && <span>{speed} ×</span>}
      </output>
    </div>
  );
}

/** The filmstrip: thumbnails, the playhead, marks of keys, and the buttons to step through the frames. */

import type { ComponentChildren } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import * as api from "../shared/api";
import { IconButton } from "./icon";
import type { Playback } from "./playback";
import type { Store } from "./store";
import { frameAt, nextKey, previousKey, shareOf, thumbnailFrames, timeCode } from "./timeline";

const THUMBNAIL_PX = 104;
const THUMBNAIL_SIDE_PX = 160;
const BUSY_MS = 800;

/** Frames with a key of the selected layer: painted, or of style and direction of the selected region. */
export function keyFrames(store: Store): number[] {
  const layer = store.layer.value;
  const prefix = `${layer.id}:`;
  const open = Object.keys(store.history.value.present.pictures).filter((key) => key.startsWith(prefix));
  const tracks = [...(layer.style_keys ?? []), ...(layer.directions ?? [])].filter(
    (key) => !store.region.value || key.region === store.region.value,
  );
  const frames = [...(layer.keys ?? []), ...tracks, ...(layer.scribbles ?? [])].map((key) => key.frame);
  return [...new Set([...frames, ...open.map((key) => Number(key.slice(prefix.length)))])].sort((a, b) => a - b);
}

interface FilmstripProps {
  store: Store;
  playback: Playback;
  /** Shown below the strip, frame by frame. */
  lane?: ComponentChildren;
}

export function Filmstrip({ store, playback, lane }: FilmstripProps) {
  const strip = useRef<HTMLDivElement>(null);
  const count = useColumns(strip);
  const { frames } = store;
  const scrub = (event: PointerEvent) => {
    const box = strip.current?.getBoundingClientRect();
    if (box) store.goTo(frameAt(event.clientX - box.left, box.width, frames));
  };
  return (
    <div class="filmstrip">
      <Transport store={store} playback={playback} />
      <div
        class="strip"
        ref={strip}
        role="slider"
        tabIndex={0}
        aria-label="Frame"
        aria-valuemin={1}
        aria-valuemax={frames}
        aria-valuenow={store.frame.value + 1}
        aria-valuetext={`Frame ${store.frame.value + 1} of ${frames}`}
        onPointerDown={(event) => {
          playback.stop();
          event.currentTarget.setPointerCapture(event.pointerId);
          scrub(event);
        }}
        onPointerMove={(event) => event.currentTarget.hasPointerCapture(event.pointerId) && scrub(event)}
        onKeyDown={(event) => {
          const by = { ArrowLeft: -1, ArrowRight: 1, PageUp: 10, PageDown: -10 }[event.key];
          if (!by) return;
          event.preventDefault();
          event.stopPropagation();
          store.goTo(store.frame.value + by);
        }}
      >
        <Thumbnails assetId={store.asset.id} shown={thumbnailFrames(count, frames)} />
        <div class="playhead" style={{ left: `${100 * shareOf(store.frame.value + 0.5, frames)}%` }} />
      </div>
      {lane}
      <KeyMarks store={store} />
    </div>
  );
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
  const marks = keyFrames(store).filter((frame) => frame < store.frames);
  const suggested = store.suggested.value.filter((frame) => !marks.includes(frame));
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
          style={{ left: `${100 * shareOf(frame + 0.5, store.frames)}%` }}
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
          style={{ left: `${100 * shareOf(frame + 0.5, store.frames)}%` }}
          onClick={() => store.goTo(frame)}
        />
      ))}
    </div>
  );
}

function Transport({ store, playback }: { store: Store; playback: Playback }) {
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
      <output class="strip-time" aria-label="Position">
        <span>
          Frame {frame + 1} of {store.frames}
        </span>
        <span>{timeCode(frame, store.fps)}</span>
        {speed !== 0 && speed !== 1 && <span>{speed} ×</span>}
      </output>
    </div>
  );
}

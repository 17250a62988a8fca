/** The filmstrip: thumbnails, the playhead, marks of keys, and the buttons to step through the frames. */

import type { ComponentChildren } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import * as api from "../../api/api";
import { IconButton } from "../../ui/icons";
import type { Cuts } from "../previews/cuts";
import { keyText } from "../state/key-bindings";
import type { Store } from "../state/store";
import {
  frameAt,
  isShown,
  nextKey,
  pieceAt,
  previousKey,
  shareOf,
  shiftSpan,
  thumbnailFrames,
  timeCode,
  zoomSpan,
} from "../state/timeline";
import { CommentLane, type Comments } from "./comments";
import { KeyMarks, keyFrames, type MoveKey } from "./key-marks";
import { Markers } from "./markers";
import { audible, looping, type Playback } from "./playback";
import { hear, silence } from "./scrub-sound";
import { TrimHandles } from "./trim";

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

interface FilmstripProps {
  store: Store;
  playback: Playback;
  cuts: Cuts;
  comments: Comments;
  movekey: MoveKey;
  /** Shown below the strip, frame by frame. */
  lane?: ComponentChildren;
}

export function Filmstrip({ store, playback, cuts, comments, movekey, lane }: FilmstripProps) {
  const strip = useRef<HTMLDivElement>(null);
  const count = useColumns(strip);
  const reach = store.reach.value;
  const span = store.span.value;
  const shown = useRested(thumbnailFrames(count, span), THUMBNAIL_REST_MS);
  const under = (event: MouseEvent) => {
    const box = strip.current?.getBoundingClientRect();
    return box ? frameAt(event.clientX - box.left, box.width, span) : store.frame.value;
  };
  const scrub = (event: PointerEvent) => {
    const before = store.frame.peek();
    store.goTo(under(event));
    if (store.frame.peek() !== before) hear(store.asset, store.frame.peek());
  };
  const wheel = (event: WheelEvent) => {
    event.preventDefault();
    const [across, along] = [event.deltaY, event.deltaX];
    store.span.value =
      Math.abs(along) > Math.abs(across)
        ? shiftSpan(span, reach, (along / WHEEL_PX) * (span[1] - span[0]))
        : zoomSpan(span, reach, WHEEL_ZOOM ** across, under(event));
  };
  return (
    <div class="filmstrip">
      <Transport store={store} playback={playback} cuts={cuts} comments={comments} />
      <div
        class="strip"
        ref={strip}
        role="slider"
        tabIndex={0}
        aria-label="Frame"
        aria-valuemin={reach[0] + 1}
        aria-valuemax={reach[1]}
        aria-valuenow={store.frame.value + 1}
        aria-valuetext={positionText(store)}
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
        {cutsWithin(store)
          .filter((cut) => isShown(cut, span))
          .map((cut) => (
            <div key={cut} class="cut-mark" style={{ left: `${100 * shareOf(cut, span)}%` }} />
          ))}
        <div class="playhead" style={{ left: `${100 * shareOf(store.frame.value + 0.5, span)}%` }} />
      </div>
      {store.trimming.value && <TrimHandles store={store} />}
      {lane}
      <KeyMarks store={store} movekey={movekey} />
      <Markers store={store} />
      <CommentLane store={store} comments={comments} />
    </div>
  );
}

/** Show `factor` times as many frames, the playhead in its place. */
function zoomStrip(store: Store, factor: number): void {
  const { span, frame, reach } = store;
  const about = isShown(frame.value, span.value) ? frame.value : (span.value[0] + span.value[1]) / 2;
  span.value = zoomSpan(span.value, reach.value, factor, about);
}

/** Cuts of the clip between the shot's in and out points. */
export function cutsWithin({ cuts, reach }: Store): number[] {
  const [first, end] = reach.value;
  return cuts.value.filter((cut) => first < cut && cut < end);
}

/** "Frame 50, 7 of 40 of the shot, piece 1 of 2": numbers of frames are the clip's; pieces lie between cuts. */
function positionText(store: Store): string {
  const frame = store.frame.value;
  const [first, end] = store.reach.value;
  const whole = end - first === store.frames;
  const at = whole ? ` of ${end}` : `, ${frame + 1 - first} of ${end - first} of the shot`;
  const cuts = cutsWithin(store);
  return `Frame ${frame + 1}${at}${cuts.length ? `, piece ${pieceAt(cuts, frame)} of ${cuts.length + 1}` : ""}`;
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

/** Steps between cuts; where the video is long, the button that finds them. */
function CutButtons({ store, cuts, step }: { store: Store; cuts: Cuts; step(to: number | undefined): void }) {
  const frame = store.frame.value;
  const starts = [store.reach.value[0], ...cutsWithin(store)];
  const done = cuts.done.value;
  return (
    <>
      {starts.length > 1 && (
        <>
          <IconButton
            name="previousCut"
            label="Previous cut"
            keys={keyText("previousCut")}
            disabled={previousKey(starts, frame) === undefined}
            onClick={() => step(previousKey(starts, frame))}
          />
          <IconButton
            name="nextCut"
            label="Next cut"
            keys={keyText("nextCut")}
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

function Transport({ store, playback, cuts, comments }: Omit<FilmstripProps, "movekey" | "lane">) {
  const keys = keyFrames(store);
  const frame = store.frame.value;
  const step = (to: number | undefined) => {
    playback.stop();
    if (to !== undefined) store.goTo(to);
  };
  const speed = playback.speed.value;
  const length = store.reach.value[1] - store.reach.value[0];
  return (
    <div class="strip-transport">
      <IconButton
        name="first"
        label="Previous key"
        disabled={previousKey(keys, frame) === undefined}
        onClick={() => step(previousKey(keys, frame))}
      />
      <IconButton name="back" label="Previous frame" keys={keyText("previous")} onClick={() => step(frame - 1)} />
      <IconButton
        name={speed ? "pause" : "play"}
        label={speed ? "Pause" : "Play"}
        keys={keyText("play")}
        onClick={playback.toggle}
      />
      <IconButton name="next" label="Next frame" keys={keyText("next")} onClick={() => step(frame + 1)} />
      <IconButton
        name="last"
        label="Next key"
        disabled={nextKey(keys, frame) === undefined}
        onClick={() => step(nextKey(keys, frame))}
      />
      <IconButton
        name="loop"
        label="Play again and again"
        keys={keyText("loop")}
        pressed={looping.value}
        onClick={() => {
          looping.value = !looping.value;
        }}
      />
      <IconButton
        name={audible.value ? "sound" : "muted"}
        label={audible.value ? "Sound off" : "Sound on"}
        {...(silence(store.asset) && { keys: silence(store.asset) })}
        onClick={() => {
          audible.value = !audible.value;
        }}
      />
      <CutButtons store={store} cuts={cuts} step={step} />
      <IconButton
        name="trim"
        label="Move the in and out points"
        keys={keyText("trim")}
        pressed={store.trimming.value}
        onClick={() => {
          playback.stop();
          store.trimming.value = !store.trimming.value;
        }}
      />
      <IconButton
        name="comment"
        label="Comment on this frame"
        pressed={comments.writing.value}
        onClick={() => {
          comments.writing.value = !comments.writing.value;
        }}
      />
      {length > ZOOM_FRAMES && (
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
            disabled={store.span.value[1] - store.span.value[0] >= length}
            onClick={() => zoomStrip(store, 2)}
          />
        </div>
      )}
      <output class="strip-time" aria-label="Position">
        <span>{positionText(store)}</span>
        <span>{timeCode(frame, store.fps)}</span>
        {speed !== 0 && speed !== 1 && <span>{speed} ×</span>}
      </output>
    </div>
  );
}

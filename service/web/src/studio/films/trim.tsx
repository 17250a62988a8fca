/** The in and out points of a shot, moved on the filmstrip, which shows the whole clip meanwhile. */

import { useRef } from "preact/hooks";
import { type Frames, framesOf, trimShot } from "../document/shots";
import { DRAG_MS } from "../document/undo";
import type { Store } from "../state/store";
import { frameAt, shareOf } from "../state/timeline";

let drags = 0;

export function TrimHandles({ store }: { store: Store }) {
  const track = useRef<HTMLDivElement>(null);
  const range = framesOf(store.shot.value, store.frames);
  const [first, end] = range;
  const span = store.span.value;
  const set = (to: Frames, group: string, within?: number) =>
    store.editDocument("Trim the shot", (one) => trimShot(one, store.shotId, to, store.frames), group, within);
  const left = 100 * Math.max(0, shareOf(first, span));
  const right = 100 * Math.min(1, shareOf(end, span));
  return (
    <div class="trim">
      <div class="trim-track" ref={track}>
        <div class="trim-kept" style={{ left: `${left}%`, right: `${100 - right}%` }} />
        <Handle
          label="In point"
          at={left}
          value={first + 1}
          least={1}
          most={end}
          frame={(x) => under(x, track.current, span)}
          onMove={(frame, group, within) => {
            set([Math.min(frame, end - 1), end], group, within);
            store.goTo(Math.min(frame, end - 1));
          }}
        />
        <Handle
          label="Out point"
          at={right}
          value={end}
          least={first + 1}
          most={store.frames}
          frame={(x) => under(x, track.current, span)}
          onMove={(frame, group, within) => {
            set([first, Math.max(frame + 1, first + 1)], group, within);
            store.goTo(Math.max(frame, first));
          }}
        />
      </div>
      <div class="actions">
        <button type="button" class="button small" onClick={() => set([Math.min(store.frame.value, end - 1), end], "")}>
          In point here
        </button>
        <button
          type="button"
          class="button small"
          onClick={() => set([first, Math.max(store.frame.value, first) + 1], "")}
        >
          Out point here
        </button>
        <button
          type="button"
          class="button small"
          disabled={end - first === store.frames}
          onClick={() => set([0, store.frames], "")}
        >
          Whole clip
        </button>
        <span class="hint" role="status">
          Frames {first + 1} to {end} of {store.frames}
        </span>
        <button
          type="button"
          class="button small primary"
          onClick={() => {
            store.trimming.value = false;
          }}
        >
          Done
        </button>
      </div>
    </div>
  );
}

function under(x: number, track: HTMLElement | null, span: Frames): number {
  const box = track?.getBoundingClientRect();
  return box ? Math.max(0, frameAt(x - box.left, box.width, span)) : span[0];
}

interface HandleProps {
  label: string;
  /** Position on the track, percent. */
  at: number;
  /** Number of the frame, from 1: the first one of the shot, or its last one. */
  value: number;
  least: number;
  most: number;
  /** The frame at a position on the screen. */
  frame(x: number): number;
  onMove(frame: number, group: string, within?: number): void;
}

function Handle({ label, at, value, least, most, frame, onMove }: HandleProps) {
  const group = useRef("");
  const steps: Record<string, number> = { ArrowLeft: -1, ArrowRight: 1, PageDown: -10, PageUp: 10 };
  return (
    <div
      class="trim-handle"
      role="slider"
      tabIndex={0}
      aria-label={label}
      aria-valuemin={least}
      aria-valuemax={most}
      aria-valuenow={value}
      aria-valuetext={`Frame ${value}`}
      style={{ left: `${at}%` }}
      onPointerDown={(event) => {
        if (event.button !== 0) return;
        event.preventDefault();
        event.currentTarget.focus({ preventScroll: true });
        event.currentTarget.setPointerCapture(event.pointerId);
        group.current = `trim-${++drags}`;
      }}
      onPointerMove={(event) => {
        if (event.currentTarget.hasPointerCapture(event.pointerId))
          onMove(frame(event.clientX), group.current, DRAG_MS);
      }}
      onKeyDown={(event) => {
        const by = steps[event.key];
        if (!by) return;
        event.preventDefault();
        event.stopPropagation();
        onMove(Math.min(Math.max(least, value + by), most) - 1, `trim-${label}`);
      }}
    />
  );
}

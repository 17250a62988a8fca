/** The marks of keys below the filmstrip: a painted key is moved or copied by dragging its mark. */

import { useState } from "preact/hooks";
import type { Section } from "../../api/schemas";
import { picturesOf } from "../document/document";
import { isPainted, pictureAt, type Store } from "../state/store";
import { clampFrame, frameAt, isShown, shareOf } from "../state/timeline";

/** A painted key goes to another frame; `copy`: and stays. */
export type MoveKey = (from: number, to: number, copy: boolean) => void;

/** Frames that are painted in the parts of these sections of the selected layer. */
export function paintedFrames(store: Store, sections: readonly Section[]): number[] {
  const layer = store.layer.value;
  const stored = sections.flatMap(({ part }) => picturesOf(layer, part)).map(({ frame }) => frame);
  const open = Object.keys(store.history.value.present.pictures)
    .map(pictureAt)
    .filter((at) => at.shot === store.shotId && at.layer === layer.id && sections.some(({ part }) => part === at.part));
  return [...new Set([...stored, ...open.map(({ frame }) => frame)])].sort((a, b) => a - b);
}

/** Frames with a key of the selected layer: painted, or of style and direction of the selected region. */
export function keyFrames(store: Store): number[] {
  const { keys = [], directions = [] } = store.design;
  const tracks = [...keys, ...directions].filter((key) => !store.region.value || key.region === store.region.value);
  const painted = paintedFrames(store, store.method.value?.studio.sections.filter(isPainted) ?? []);
  return [...new Set([...painted, ...tracks.map(({ frame }) => frame)])].sort((a, b) => a - b);
}

/** CSS px that a key is dragged before it moves. */
const DRAG_PX = 4;

export function KeyMarks({ store, movekey }: { store: Store; movekey: MoveKey }) {
  const [drag, setDrag] = useState<{ from: number; at: number; x: number; moved: boolean } | null>(null);
  const section = store.section("keys");
  const movable = section ? paintedFrames(store, [section]) : [];
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
          title={
            movable.includes(frame)
              ? `Key at frame ${frame + 1}. Drag it, or Alt with the arrow keys: move it; drag with Ctrl: copy it.`
              : `Key at frame ${frame + 1}`
          }
          style={{ left: `${100 * shareOf((drag?.moved && drag.from === frame ? drag.at : frame) + 0.5, span)}%` }}
          onClick={() => store.goTo(frame)}
          onPointerDown={(event) => {
            if (event.button !== 0 || !movable.includes(frame)) return;
            event.currentTarget.setPointerCapture(event.pointerId);
            setDrag({ from: frame, at: frame, x: event.clientX, moved: false });
          }}
          onPointerMove={(event) => {
            const box = event.currentTarget.parentElement?.getBoundingClientRect();
            if (!drag || !box) return;
            const moved = drag.moved || Math.abs(event.clientX - drag.x) > DRAG_PX;
            const at = clampFrame(frameAt(event.clientX - box.left, box.width, span), store.reach.value);
            setDrag({ ...drag, at, moved });
          }}
          onPointerUp={(event) => {
            if (drag?.moved && drag.at !== drag.from) movekey(drag.from, drag.at, event.altKey || event.ctrlKey);
            setDrag(null);
          }}
          onPointerCancel={() => setDrag(null)}
          onKeyDown={(event) => {
            const by = event.altKey && { ArrowLeft: -1, ArrowRight: 1 }[event.key];
            if (!by || !movable.includes(frame)) return;
            event.preventDefault();
            event.stopPropagation();
            const to = clampFrame(frame + by, store.reach.value);
            if (to !== frame) movekey(frame, to, false);
          }}
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

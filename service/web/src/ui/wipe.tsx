/** Two pictures one over the other, and a handle that wipes between them: by pointer, touch or keyboard. */

import type { ComponentChildren } from "preact";
import { useRef, useState } from "preact/hooks";

const STEPS: Record<string, number> = {
  ArrowLeft: -2,
  ArrowDown: -2,
  ArrowRight: 2,
  ArrowUp: 2,
  PageDown: -10,
  PageUp: 10,
  Home: -100,
  End: 100,
};

export type Side = "before" | "after";

export interface WipeProps {
  /** Left of the handle. */
  before: ComponentChildren;
  after: ComponentChildren;
  labels?: readonly [before: string, after: string];
  /** One picture only; null: both with the handle. */
  alone?: Side | null;
}

export function Wipe({ before, after, labels = ["Original", "Painted"], alone = null }: WipeProps) {
  const [split, setSplit] = useState(50);
  const [dragging, setDragging] = useState(false);
  const handle = useRef<HTMLDivElement>(null);
  const move = (percent: number) => setSplit(Math.min(100, Math.max(0, percent)));
  const follow = (event: PointerEvent, element: HTMLElement) => {
    const box = element.getBoundingClientRect();
    move((100 * (event.clientX - box.left)) / box.width);
  };
  const style = ["wipe", dragging && "dragging", split < 14 && "at-start", split > 86 && "at-end"];
  return (
    <div
      class={style.filter(Boolean).join(" ")}
      data-alone={alone ?? ""}
      style={{ "--split": `${split}%` }}
      onPointerDown={(event) => {
        if (event.button !== 0 || alone) return;
        event.currentTarget.setPointerCapture(event.pointerId);
        setDragging(true);
        handle.current?.focus({ preventScroll: true });
        event.preventDefault();
        follow(event, event.currentTarget);
      }}
      onPointerMove={(event) => {
        if (event.currentTarget.hasPointerCapture(event.pointerId)) follow(event, event.currentTarget);
      }}
      onLostPointerCapture={() => setDragging(false)}
    >
      <div class="wipe-layer wipe-before">{before}</div>
      <div class="wipe-layer wipe-after">{after}</div>
      {labels.map((text, i) => (
        <span key={text} class={`wipe-tag wipe-tag-${i}`} aria-hidden="true">
          {text}
        </span>
      ))}
      <div
        ref={handle}
        class="wipe-handle"
        role="slider"
        tabIndex={alone ? -1 : 0}
        aria-label={`Compare ${labels[0].toLowerCase()} and ${labels[1].toLowerCase()}`}
        aria-valuemin={0}
        aria-valuemax={100}
        aria-valuenow={Math.round(split)}
        aria-valuetext={`${Math.round(split)} % ${labels[0].toLowerCase()}`}
        onKeyDown={(event) => {
          const step = STEPS[event.key];
          if (step === undefined) return;
          event.preventDefault();
          move(split + step * (event.shiftKey ? 5 : 1));
        }}
      >
        <span class="wipe-grip" />
      </div>
    </div>
  );
}

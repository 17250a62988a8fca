/** A number over time: its curve, with keys that can be dragged up and down. */

import { useState } from "preact/hooks";

/** (frame, value) of a key. */
export type Key = readonly [frame: number, value: number];

const POINTS = 160;
/** Free room above and below the curve, as a share of its range, and at least as a share of the parameter's. */
const ROOM = 0.25;
const LEAST_ROOM = 0.02;
/** Where the curve's ends are, percent of its height from the top. */
const [TOP, BOTTOM] = [8, 92];

interface ValueCurveProps {
  /** Frames [first, end) that are shown. */
  span: readonly [number, number];
  /** The present frame. */
  frame: number;
  keys: readonly Key[];
  /** The value of any frame. */
  value(frame: number): number;
  minimum: number;
  maximum: number;
  step: number;
  title: string;
  /** What has the number: "sky"; empty: nothing else. */
  of?: string;
  onSet(frame: number, value: number): void;
}

export function ValueCurve(props: ValueCurveProps) {
  const { span, frame: now, keys, value, minimum, maximum, step, title, of = "", onSet } = props;
  const [held, setHeld] = useState<readonly [number, number] | null>(null);
  const frames = Array.from({ length: POINTS + 1 }, (_, i) => span[0] + ((span[1] - span[0]) * i) / POINTS);
  const curve = frames.map(value);
  const [least, most] = held ?? rangeOf([...curve, ...keys.map(([, number]) => number)], maximum - minimum);
  const height = (number: number) => BOTTOM - ((BOTTOM - TOP) * (number - least)) / (most - least);
  const course = keys.map(([frame, number]) => `${round(number)} at frame ${frame + 1}`).join(", ");
  const setAt = (frame: number, wanted: number) =>
    onSet(frame, Number(Math.min(maximum, Math.max(minimum, Math.round(wanted / step) * step)).toFixed(4)));
  return (
    <>
      <svg
        viewBox={`${span[0]} 0 ${span[1] - span[0]} 100`}
        preserveAspectRatio="none"
        role="img"
        aria-label={`${title}${of && ` of ${of}`}: ${course}`}
      >
        <polyline points={frames.map((frame, i) => `${frame + 0.5},${height(curve[i] ?? 0)}`).join(" ")} />
        <path class="now" d={`M${now} 0h1v100h-1z`} />
      </svg>
      {keys.map(([frame, number]) => {
        if (frame < span[0] || frame >= span[1]) return null;
        return (
          <div
            key={frame}
            class="curve-key"
            role="slider"
            tabIndex={0}
            aria-label={`${title} at frame ${frame + 1}`}
            aria-orientation="vertical"
            aria-valuemin={minimum}
            aria-valuemax={maximum}
            aria-valuenow={round(number)}
            title={`${title} at frame ${frame + 1}: ${round(number)}. Drag it up or down.`}
            style={{ left: `${(100 * (frame + 0.5 - span[0])) / (span[1] - span[0])}%`, top: `${height(number)}%` }}
            onPointerDown={(event) => {
              if (event.button !== 0) return;
              event.currentTarget.setPointerCapture(event.pointerId);
              setHeld([least, most]);
            }}
            onPointerMove={(event) => {
              const box = event.currentTarget.parentElement?.getBoundingClientRect();
              if (!held || !box?.height) return;
              const at = (100 * (event.clientY - box.top)) / box.height;
              setAt(frame, least + ((BOTTOM - at) / (BOTTOM - TOP)) * (most - least));
            }}
            onPointerUp={() => setHeld(null)}
            onPointerCancel={() => setHeld(null)}
            onKeyDown={(event) => {
              const by = { ArrowUp: step, ArrowDown: -step }[event.key];
              if (!by) return;
              event.preventDefault();
              event.stopPropagation();
              setAt(frame, number + by);
            }}
          />
        );
      })}
    </>
  );
}

function rangeOf(values: readonly number[], whole: number): [number, number] {
  const [least, most] = [Math.min(...values), Math.max(...values)];
  const room = Math.max(ROOM * (most - least), LEAST_ROOM * whole);
  return [least - room, most + room];
}

export const round = (value: number): number => Math.round(100 * value) / 100;

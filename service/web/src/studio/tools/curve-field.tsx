/** A curve of three points, whose heights are dragged or set by the arrow keys. */

import { useRef } from "preact/hooks";
import type { Curve } from "../document/tip";
import { valueAt } from "../drawing/curves";
import { clamp } from "../drawing/geometry";

const WIDTH = 200;
const HEIGHT = 100;
const POINTS = [0, 1, 2] as const;
const STEP = 0.05;

export interface CurveFieldProps {
  name: string;
  /** What the left and the right end stand for. */
  ends: readonly [string, string];
  /** Largest value. */
  most: number;
  curve: Curve;
  onChange(curve: Curve): void;
}

export function CurveField({ name, ends, most, curve, onChange }: CurveFieldProps) {
  const plot = useRef<SVGSVGElement>(null);
  const height = (value: number) => HEIGHT * (1 - value / most);
  const line = Array.from({ length: 41 }, (_, i) => `${(WIDTH * i) / 40},${height(valueAt(curve, i / 40)).toFixed(1)}`);
  const set = (point: number, value: number) => {
    const bounded = clamp(Math.round(value * 100) / 100, 0, most);
    onChange(curve.map((old, i) => (i === point ? bounded : old)) as unknown as Curve);
  };
  const drag = (point: number) => (event: PointerEvent) => {
    const box = plot.current?.getBoundingClientRect();
    const target = event.currentTarget as Element;
    if (!box || (event.type === "pointermove" && !target.hasPointerCapture(event.pointerId))) return;
    target.setPointerCapture(event.pointerId);
    set(point, most * (1 - (event.clientY - box.top) / box.height));
  };
  const press = (point: 0 | 1 | 2) => (event: KeyboardEvent) => {
    const by = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1 }[event.key];
    if (!by) return;
    event.preventDefault();
    event.stopPropagation();
    set(point, curve[point] + by * STEP * most);
  };
  const places = [ends[0], "middle", ends[1]];
  return (
    <figure class="curve-field">
      <svg ref={plot} viewBox={`0 0 ${WIDTH} ${HEIGHT}`} role="group" aria-label={name}>
        <polyline points={line.join(" ")} />
        {POINTS.map((point) => (
          <circle
            key={point}
            cx={(WIDTH * point) / 2}
            cy={height(curve[point])}
            r={7}
            tabIndex={0}
            role="slider"
            aria-label={`${name}, ${places[point]}`}
            aria-valuemin={0}
            aria-valuemax={100 * most}
            aria-valuenow={Math.round(100 * curve[point])}
            aria-valuetext={`${Math.round(100 * curve[point])} %`}
            onPointerDown={drag(point)}
            onPointerMove={drag(point)}
            onKeyDown={press(point)}
          />
        ))}
      </svg>
      <figcaption>
        <span>{ends[0]}</span>
        <span>{ends[1]}</span>
      </figcaption>
    </figure>
  );
}

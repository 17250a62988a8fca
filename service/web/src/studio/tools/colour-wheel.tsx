/** A colour wheel: hue around, saturation and value in the square within. */

import { useEffect, useRef } from "preact/hooks";
import { type Hsv, hexOf, hsvOf, rgbOfHsv } from "../../ui/palette";
import { Slider } from "../../ui/slider";
import { clamp } from "../drawing/geometry";
import { rgbOf } from "../drawing/stroke-mask";

/** Side of the wheel, px, the inner radius of its ring, and half the side of its square. */
const SIDE = 200;
const MIDDLE = SIDE / 2;
const RING = 78;
const HALF = 52;

export interface ColourWheelProps {
  color: string;
  onChange(color: string): void;
}

export function ColourWheel({ color, onChange }: ColourWheelProps) {
  const canvas = useRef<HTMLCanvasElement>(null);
  /** Gray has no hue, black no saturation: those of the last colour stay. */
  const last = useRef<Hsv>({ hue: 0, saturation: 0, value: 0 });
  const seen = hsvOf(rgbOf(color));
  const hsv =
    hexOf(rgbOfHsv(last.current)) === color
      ? last.current
      : { ...seen, ...(seen.saturation ? {} : { hue: last.current.hue }) };
  last.current = hsv;
  const part = useRef<"ring" | "square" | null>(null);
  const set = (change: Partial<Hsv>) => {
    last.current = { ...last.current, ...change };
    onChange(hexOf(rgbOfHsv(last.current)));
  };
  useEffect(() => {
    if (canvas.current) drawWheel(canvas.current, hsv);
  }, [hsv.hue, hsv.saturation, hsv.value]);
  const point = (event: PointerEvent) => {
    const box = canvas.current?.getBoundingClientRect();
    const target = event.currentTarget as Element;
    if (!box) return;
    const [x, y] = [
      ((event.clientX - box.left) / box.width) * SIDE - MIDDLE,
      ((event.clientY - box.top) / box.height) * SIDE - MIDDLE,
    ];
    if (event.type === "pointerdown") {
      part.current = Math.hypot(x, y) > RING - 6 ? "ring" : "square";
      target.setPointerCapture(event.pointerId);
    } else if (!target.hasPointerCapture(event.pointerId)) return;
    if (part.current === "ring") set({ hue: ((Math.atan2(y, x) * 180) / Math.PI + 360) % 360 });
    else set({ saturation: clamp((x + HALF) / (2 * HALF), 0, 1), value: clamp((HALF - y) / (2 * HALF), 0, 1) });
  };
  return (
    <>
      <canvas
        ref={canvas}
        class="colour-wheel"
        width={SIDE}
        height={SIDE}
        role="img"
        aria-label="Colour wheel; the sliders below set the same"
        onPointerDown={point}
        onPointerMove={point}
      />
      <div class="drawing-fields">
        <Slider
          label="Hue"
          min={0}
          max={359}
          value={Math.round(hsv.hue)}
          text={`${Math.round(hsv.hue)}°`}
          onChange={(hue) => set({ hue })}
        />
        <Slider
          label="Saturation"
          min={0}
          max={100}
          value={Math.round(100 * hsv.saturation)}
          text={`${Math.round(100 * hsv.saturation)} %`}
          onChange={(value) => set({ saturation: value / 100 })}
        />
        <Slider
          label="Brightness"
          min={0}
          max={100}
          value={Math.round(100 * hsv.value)}
          text={`${Math.round(100 * hsv.value)} %`}
          onChange={(value) => set({ value: value / 100 })}
        />
      </div>
    </>
  );
}

function drawWheel(canvas: HTMLCanvasElement, { hue, saturation, value }: Hsv): void {
  const context = canvas.getContext("2d");
  if (!context) return;
  context.clearRect(0, 0, SIDE, SIDE);
  const ring = context.createConicGradient(0, MIDDLE, MIDDLE);
  for (let turn = 0; turn <= 12; turn++)
    ring.addColorStop(turn / 12, hexOf(rgbOfHsv({ hue: 30 * turn, saturation: 1, value: 1 })));
  context.beginPath();
  context.arc(MIDDLE, MIDDLE, MIDDLE - 1, 0, 2 * Math.PI);
  context.arc(MIDDLE, MIDDLE, RING, 0, 2 * Math.PI, true);
  context.fillStyle = ring;
  context.fill();
  const [left, side] = [MIDDLE - HALF, 2 * HALF];
  const across = context.createLinearGradient(left, 0, left + side, 0);
  across.addColorStop(0, "#fff");
  across.addColorStop(1, hexOf(rgbOfHsv({ hue, saturation: 1, value: 1 })));
  const down = context.createLinearGradient(0, left, 0, left + side);
  down.addColorStop(0, "rgb(0 0 0 / 0%)");
  down.addColorStop(1, "#000");
  for (const fill of [across, down]) {
    context.fillStyle = fill;
    context.fillRect(left, left, side, side);
  }
  const turn = (hue * Math.PI) / 180;
  const middle = (RING + MIDDLE) / 2;
  dot(context, MIDDLE + middle * Math.cos(turn), MIDDLE + middle * Math.sin(turn));
  dot(context, left + saturation * side, left + (1 - value) * side);
}

function dot(context: CanvasRenderingContext2D, x: number, y: number): void {
  for (const [color, width] of [
    ["#000", 4],
    ["#fff", 2],
  ] as const) {
    Object.assign(context, { strokeStyle: color, lineWidth: width });
    context.beginPath();
    context.arc(x, y, 6, 0, 2 * Math.PI);
    context.stroke();
  }
}

/** A minute of latency, rate and drops, drawn on a canvas in the colours of the page. */

import { h } from "../ui/dom";
import { KEPT_S, type Second } from "./figures";

const PAD = { left: 46, right: 40, top: 10, bottom: 18 };
const ROUND = [50, 100, 150, 200, 300, 500, 1000, 2000, 5000, 10_000];

type Point = [x: number, y: number];
type Scale = (value: number) => number;
type Ink = (name: string) => string;
type Context = CanvasRenderingContext2D;
type Curve = "fps" | "glassMs" | "serverMs";

interface Box {
  left: number;
  top: number;
  right: number;
  bottom: number;
}

export interface Graph {
  element: HTMLCanvasElement;
  draw(history: Second[], targetFps: number): void;
}

export function createGraph(): Graph {
  const label = "The last minute: latency, frame rate and dropped frames";
  const element = h("canvas", { class: "live-graph", role: "img", "aria-label": label });
  const context = element.getContext("2d");
  let drawn: [Second[], number] | null = null;

  function draw(history: Second[], targetFps: number): void {
    drawn = [history, targetFps];
    const { clientWidth: width, clientHeight: height } = element;
    if (!width || !context) return;
    const ratio = devicePixelRatio || 1;
    const size = { width: Math.round(width * ratio), height: Math.round(height * ratio) };
    if (element.width !== size.width || element.height !== size.height) Object.assign(element, size);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    plot(context, { width, height }, history, targetFps, palette(element));
  }

  new ResizeObserver(() => drawn && draw(...drawn)).observe(element);
  return { element, draw };
}

function palette(element: HTMLElement): Ink {
  const style = getComputedStyle(element);
  return (name) => style.getPropertyValue(`--${name}`);
}

function plot(
  context: Context,
  size: { width: number; height: number },
  history: Second[],
  targetFps: number,
  ink: Ink,
): void {
  const box = { left: PAD.left, top: PAD.top, right: size.width - PAD.right, bottom: size.height - PAD.bottom };
  const x: Scale = (age) => box.right - (age / KEPT_S) * (box.right - box.left);
  const scale =
    (top: number): Scale =>
    (value) =>
      box.bottom - (Math.min(value, top) / top) * (box.bottom - box.top);
  const most = Math.max(40, ...history.map((second) => second.glassMs ?? 0)) * 1.1;
  const topMs = ROUND.find((round) => round >= most) ?? most;
  const topFps = Math.max(10, targetFps * 1.15);
  grid(context, box, scale(topMs), topMs, ink);
  drops(context, box, x, history, ink("alarm"));
  line(context, runs(x, scale(topFps), history, "fps"), ink("viridian"), 1.5);
  area(context, box, runs(x, scale(topMs), history, "glassMs"), ink("vermilion"));
  line(context, runs(x, scale(topMs), history, "serverMs"), ink("ultramarine"), 1.5);
  line(context, runs(x, scale(topMs), history, "glassMs"), ink("vermilion"), 2);
  axis(context, box, scale(topFps), targetFps, ink);
}

function grid(context: Context, box: Box, y: Scale, topMs: number, ink: Ink): void {
  write(context, ink("soft"));
  context.strokeStyle = ink("rule");
  context.lineWidth = 1;
  context.textAlign = "right";
  for (const value of [0, topMs / 2, topMs]) {
    stroke(context, [
      [box.left, y(value)],
      [box.right, y(value)],
    ]);
    context.fillText(value === topMs ? `${value} ms` : String(value), box.left - 7, y(value));
  }
}

function axis(context: Context, box: Box, y: Scale, targetFps: number, ink: Ink): void {
  write(context, ink("viridian"));
  context.textAlign = "left";
  context.fillText(`${targetFps} fps`, box.right + 6, y(targetFps));
  context.fillStyle = ink("soft");
  context.textBaseline = "top";
  context.fillText("60 s ago", box.left, box.bottom + 5);
  context.textAlign = "right";
  context.fillText("now", box.right, box.bottom + 5);
}

function write(context: Context, colour: string): void {
  context.font = "11px system-ui, sans-serif";
  context.textBaseline = "middle";
  context.fillStyle = colour;
}

/** Bars from the bottom: the share of a second's frames that were dropped. */
function drops(context: Context, box: Box, x: Scale, history: Second[], colour: string): void {
  context.fillStyle = colour;
  context.globalAlpha = 0.55;
  history.forEach((second, i) => {
    const share = second.offered ? Math.min(1, second.dropped / second.offered) : 0;
    const tall = share && Math.max(2, share * (box.bottom - box.top));
    context.fillRect(x(history.length - i) + 1, box.bottom - tall, x(0) - x(1) - 2, tall);
  });
  context.globalAlpha = 1;
}

/** Runs of seconds that have the value, as points. */
function runs(x: Scale, y: Scale, history: Second[], name: Curve): Point[][] {
  const found: Point[][] = [[]];
  history.forEach((second, i) => {
    const value = second[name];
    if (value === null) found.push([]);
    else found.at(-1)?.push([x(history.length - i - 0.5), y(value)]);
  });
  return found.filter((run) => run.length > 1);
}

function line(context: Context, found: Point[][], colour: string, width: number): void {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.lineJoin = "round";
  for (const run of found) stroke(context, run);
}

function area(context: Context, box: Box, found: Point[][], colour: string): void {
  context.fillStyle = colour;
  context.globalAlpha = 0.12;
  for (const run of found) {
    const [first, last] = [run[0], run.at(-1)];
    if (!first || !last) continue;
    context.beginPath();
    context.moveTo(first[0], box.bottom);
    for (const point of run) context.lineTo(...point);
    context.lineTo(last[0], box.bottom);
    context.fill();
  }
  context.globalAlpha = 1;
}

function stroke(context: Context, [first, ...rest]: Point[]): void {
  if (!first) return;
  context.beginPath();
  context.moveTo(...first);
  for (const point of rest) context.lineTo(...point);
  context.stroke();
}

/** A minute of latency, rate and drops, drawn on a canvas in the colours of the page. */

import { h } from "../dom.js";
import { KEPT_S } from "./figures.js";

const PAD = { left: 46, right: 40, top: 10, bottom: 18 };
const ROUND = [50, 100, 150, 200, 300, 500, 1000, 2000, 5000, 10_000];

/** @returns {{element, draw(history: object[], targetFps: number)}} */
export function createGraph() {
  const element = h("canvas", { class: "live-graph", role: "img", "aria-label": "The last minute: latency, frame rate and dropped frames" });
  const context = element.getContext("2d");
  let drawn = null;

  function draw(history, targetFps) {
    drawn = [history, targetFps];
    const { clientWidth: width, clientHeight: height } = element;
    if (!width) return;
    const ratio = devicePixelRatio || 1;
    if (element.width !== Math.round(width * ratio) || element.height !== Math.round(height * ratio)) Object.assign(element, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    plot(context, { width, height }, history, targetFps, palette(element));
  }

  new ResizeObserver(() => drawn && draw(...drawn)).observe(element);
  return { element, draw };
}

function palette(element) {
  const style = getComputedStyle(element);
  return (name) => style.getPropertyValue(`--${name}`);
}

function plot(context, { width, height }, history, targetFps, ink) {
  const box = { left: PAD.left, top: PAD.top, right: width - PAD.right, bottom: height - PAD.bottom };
  const x = (age) => box.right - (age / KEPT_S) * (box.right - box.left);
  const scale = (top) => (value) => box.bottom - (Math.min(value, top) / top) * (box.bottom - box.top);
  const most = Math.max(40, ...history.map((second) => second.glassMs ?? 0)) * 1.1;
  const topMs = ROUND.find((round) => round >= most) ?? most;
  const topFps = Math.max(10, targetFps * 1.15);
  grid(context, box, scale(topMs), topMs, ink);
  drops(context, box, x, history, ink("alarm"));
  line(context, x, scale(topFps), history, "fps", ink("viridian"), 1.5);
  area(context, box, x, scale(topMs), history, ink("vermilion"));
  line(context, x, scale(topMs), history, "serverMs", ink("ultramarine"), 1.5);
  line(context, x, scale(topMs), history, "glassMs", ink("vermilion"), 2);
  axis(context, box, scale(topFps), targetFps, ink);
}

function grid(context, box, y, topMs, ink) {
  write(context, ink("soft"));
  context.strokeStyle = ink("rule");
  context.lineWidth = 1;
  context.textAlign = "right";
  for (const value of [0, topMs / 2, topMs]) {
    stroke(context, [[box.left, y(value)], [box.right, y(value)]]);
    context.fillText(value === topMs ? `${value} ms` : String(value), box.left - 7, y(value));
  }
}

function axis(context, box, y, targetFps, ink) {
  write(context, ink("viridian"));
  context.textAlign = "left";
  context.fillText(`${targetFps} fps`, box.right + 6, y(targetFps));
  context.fillStyle = ink("soft");
  context.textBaseline = "top";
  context.fillText("60 s ago", box.left, box.bottom + 5);
  context.textAlign = "right";
  context.fillText("now", box.right, box.bottom + 5);
}

function write(context, colour) {
  context.font = "11px system-ui, sans-serif";
  context.textBaseline = "middle";
  context.fillStyle = colour;
}

/** Bars from the ground: the share of a second's frames that were dropped. */
function drops(context, box, x, history, colour) {
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
function runs(x, y, history, name) {
  const found = [[]];
  history.forEach((second, i) => {
    if (second[name] === null) found.push([]);
    else found.at(-1).push([x(history.length - i - 0.5), y(second[name])]);
  });
  return found.filter((run) => run.length > 1);
}

function line(context, x, y, history, name, colour, width) {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.lineJoin = "round";
  for (const run of runs(x, y, history, name)) stroke(context, run);
}

function area(context, box, x, y, history, colour) {
  context.fillStyle = colour;
  context.globalAlpha = 0.12;
  for (const run of runs(x, y, history, "glassMs")) {
    context.beginPath();
    context.moveTo(run[0][0], box.bottom);
    run.forEach((point) => context.lineTo(...point));
    context.lineTo(run.at(-1)[0], box.bottom);
    context.fill();
  }
  context.globalAlpha = 1;
}

function stroke(context, [first, ...rest]) {
  context.beginPath();
  context.moveTo(...first);
  rest.forEach((point) => context.lineTo(...point));
  context.stroke();
}

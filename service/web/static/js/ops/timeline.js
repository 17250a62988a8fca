/** A job's attempts over time: a lane a slot, a bar an attempt, a colour a step. */

import { fill, h } from "../dom.js";
import { duration, percent } from "../format.js";
import { createLog } from "./failures.js";
import { shortId } from "./fleet.js";

const SVG = "http://www.w3.org/2000/svg";
const [LANE, BAR, AXIS] = [22, 14, 26];
const COLOURS = 6;
const WORDS = { succeeded: "succeeded", running: "runs", failed: "failed", interrupted: "was cut off", released: "was given back", cancelled: "was cancelled" };

/** @returns {{element, update(job, bars, now)}}  `bars` of /timeline, `now` by the server's clock. */
export function createTimeline() {
  const head = h("div", { class: "timeline-head" });
  const legend = h("ul", { class: "legend" });
  const box = h("div", { class: "timeline-box" });
  const chosen = h("div", { class: "timeline-chosen" });
  const element = h("div", { class: "timeline" }, head, legend, box, chosen);
  let last = null;

  function draw() {
    if (!last) return;
    const { job, bars, now } = last;
    const steps = job.steps.map((step) => step.name);
    const lanes = lanesOf(bars);
    const span = spanOf(bars, now);
    fill(head, h("p", {}, summary(bars, lanes, span)));
    fill(legend, job.steps.filter((step) => bars.some((bar) => bar.step === step.name)).map((step) => h("li", { class: colour(steps.indexOf(step.name)) }, h("span", {}, step.title))));
    fill(box, lanes.length ? picture(lanes, steps, span, box.clientWidth || 600, choose) : h("p", { class: "nothing" }, "Nothing has run yet."));
  }

  function choose(bar) {
    const log = createLog(bar.attempt_id);
    fill(chosen, h("p", {}, tell(bar)), h("div", { class: "actions" }, log.button), log.element);
    log.button.click();
  }

  new ResizeObserver(draw).observe(box);
  return {
    element,
    update(job, bars, now) {
      if (last?.job.id !== job.id) fill(chosen);
      last = { job, bars: bars.filter((bar) => bar.slot || bar.outcome !== "running"), now }; // on its way to a slot
      draw();
    },
  };
}

const colour = (index) => `step-${((index % COLOURS) + COLOURS) % COLOURS}`;

/** Slots in the order of their names, each with its bars. */
function lanesOf(bars) {
  const lanes = new Map();
  const several = new Set(bars.map((bar) => bar.worker)).size > 1;
  for (const bar of bars) {
    const name = `${bar.worker.split("@")[1] ?? bar.worker} ${shortId(bar.worker)} ${bar.slot}`;
    if (!lanes.has(name)) lanes.set(name, { name, short: (several ? `${shortId(bar.worker)} · ` : "") + slotName(bar.slot), bars: [] });
    lanes.get(name).bars.push(bar);
  }
  return [...lanes.values()].sort((a, b) => a.name.localeCompare(b.name, undefined, { numeric: true }));
}

const slotName = (slot) => slot.replace(/^impasto-worker-/, "slot ") || "no slot";

function spanOf(bars, now) {
  const from = Math.min(...bars.map((bar) => bar.started_at));
  const to = Math.max(...bars.map((bar) => bar.finished_at ?? Math.max(now, bar.started_at)));
  return { from, to: Math.max(to, from + 0.1) };
}

function summary(bars, lanes, { from, to }) {
  if (!bars.length) return "";
  const busy = bars.reduce((sum, bar) => sum + ((bar.finished_at ?? to) - bar.started_at), 0);
  return `${bars.length} attempts on ${lanes.length} ${lanes.length === 1 ? "slot" : "slots"} in ${duration(to - from)}; the slots were at work for ${percent(busy / (lanes.length * (to - from)))} of it.`;
}

function tell(bar) {
  const took = bar.finished_at ? `${duration(bar.finished_at - bar.started_at)}` : "still at work";
  return [`${bar.step} · ${bar.key}`, `attempt ${bar.number} ${WORDS[bar.outcome] ?? bar.outcome}${bar.code && ` (${bar.code})`}`, took, `${bar.slot || "no slot"} of ${bar.worker}`].join("\n");
}

function s(tag, attributes, ...children) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

function picture(lanes, steps, span, width, choose) {
  const left = Math.min(150, Math.round(width * 0.24));
  const height = lanes.length * LANE + AXIS;
  const x = (at) => left + ((at - span.from) / (span.to - span.from)) * (width - left - 8);
  const title = `Attempts of the job over ${duration(span.to - span.from)}, by slot`;
  const svg = s("svg", { width, height, viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": title });
  svg.append(...ticks(span, x, height, width));
  lanes.forEach((lane, i) => {
    svg.append(s("text", { x: left - 8, y: i * LANE + LANE / 2, class: "lane-name" }, lane.short, s("title", {}, lane.name)));
    svg.append(s("line", { x1: left, x2: width, y1: (i + 1) * LANE, y2: (i + 1) * LANE, class: "lane" }));
    for (const bar of lane.bars) svg.append(block(bar, i, steps, span, x, choose));
  });
  return svg;
}

function block(bar, lane, steps, span, x, choose) {
  const [from, to] = [x(bar.started_at), x(bar.finished_at ?? span.to)];
  const at = { x: from.toFixed(1), y: lane * LANE + (LANE - BAR) / 2, width: Math.max(1.5, to - from - 0.5).toFixed(1), height: BAR, rx: 2 };
  const rect = s("rect", { ...at, class: `bar ${colour(steps.indexOf(bar.step))}`, "data-outcome": bar.outcome }, s("title", {}, tell(bar)));
  rect.addEventListener("click", () => choose(bar));
  return rect;
}

/** Four or so round times below the lanes. */
function ticks({ from, to }, x, height, width) {
  const raw = (to - from) / Math.max(2, Math.min(8, width / 130));
  const unit = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((n) => n * unit).find((n) => n >= raw);
  const times = Array.from({ length: Math.floor((to - from) / step) + 1 }, (_, i) => i * step);
  return times.flatMap((t) => [
    s("line", { x1: x(from + t), x2: x(from + t), y1: 0, y2: height - AXIS + 5, class: "tick" }),
    s("text", { x: x(from + t), y: height - 6, class: "tick-name" }, step < 1 ? `${t.toFixed(1)} s` : duration(t).replace(".0", "")),
  ]);
}

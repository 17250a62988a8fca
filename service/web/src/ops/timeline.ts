/** A job's attempts over time: a lane per slot, a bar per attempt, a colour per step. */

import type { Job } from "../api/schemas";
import { fill, h } from "../ui/dom";
import { duration, percent } from "../ui/format";
import { createLog } from "./failures";
import { shortId } from "./fleet";
import type { Bar } from "./types";

const SVG = "http://www.w3.org/2000/svg";
const LANE_PX = 22;
const BAR_PX = 14;
const AXIS_PX = 26;
const COLOURS = 6;
const WORDS: Record<string, string> = {
  succeeded: "succeeded",
  running: "runs",
  failed: "failed",
  interrupted: "was interrupted",
  released: "was given back",
  cancelled: "was cancelled",
};

interface Lane {
  name: string;
  short: string;
  bars: Bar[];
}

/** Seconds since the epoch. */
interface Span {
  from: number;
  to: number;
}

type Choose = (bar: Bar) => void;

export interface Timeline {
  element: HTMLElement;
  /** `now` by the server's clock. */
  update(job: Job, bars: Bar[], now: number): void;
}

export function createTimeline(): Timeline {
  const head = h("div", { class: "timeline-head" });
  const legend = h("ul", { class: "legend" });
  const box = h("div", { class: "timeline-box" });
  const chosen = h("div", { class: "timeline-chosen" });
  const element = h("div", { class: "timeline" }, head, legend, box, chosen);
  let last: { job: Job; bars: Bar[]; now: number } | null = null;

  function draw(): void {
    if (!last) return;
    const { job, bars, now } = last;
    const steps = job.steps.map((step) => step.name);
    const lanes = lanesOf(bars);
    const span = spanOf(bars, now);
    const used = job.steps.filter((step) => bars.some((bar) => bar.step === step.name));
    fill(head, h("p", {}, summary(bars, lanes, span)));
    fill(
      legend,
      used.map((step) => h("li", { class: colour(steps.indexOf(step.name)) }, h("span", {}, step.title))),
    );
    fill(
      box,
      lanes.length
        ? picture(lanes, steps, span, box.clientWidth || 600, choose)
        : h("p", { class: "placeholder" }, "Nothing has run yet."),
    );
  }

  function choose(bar: Bar): void {
    const log = createLog(bar.attempt_id);
    fill(chosen, h("p", {}, describe(bar)), h("div", { class: "actions" }, log.button), log.element);
    log.button.click();
  }

  new ResizeObserver(draw).observe(box);
  return {
    element,
    update(job, bars, now) {
      if (last?.job.id !== job.id) fill(chosen);
      const shown = bars.filter((bar) => bar.slot || bar.outcome !== "running"); // without a slot: not started yet
      last = { job, bars: shown, now };
      draw();
    },
  };
}

const colour = (index: number): string => `step-${((index % COLOURS) + COLOURS) % COLOURS}`;

/** Slots in the order of their names, each with its bars. */
function lanesOf(bars: Bar[]): Lane[] {
  const lanes = new Map<string, Lane>();
  const several = new Set(bars.map((bar) => bar.worker)).size > 1;
  for (const bar of bars) {
    const name = `${bar.worker.split("@")[1] ?? bar.worker} ${shortId(bar.worker)} ${bar.slot}`;
    const short = (several ? `${shortId(bar.worker)} · ` : "") + slotName(bar.slot);
    const lane = lanes.get(name) ?? { name, short, bars: [] };
    lane.bars.push(bar);
    lanes.set(name, lane);
  }
  return [...lanes.values()].sort((a, b) => a.name.localeCompare(b.name, undefined, { numeric: true }));
}

const slotName = (slot: string): string => slot.replace(/^impasto-worker-/, "slot ") || "no slot";

function spanOf(bars: Bar[], now: number): Span {
  const from = Math.min(...bars.map((bar) => bar.started_at));
  const to = Math.max(...bars.map((bar) => bar.finished_at ?? Math.max(now, bar.started_at)));
  return { from, to: Math.max(to, from + 0.1) };
}

function summary(bars: Bar[], lanes: Lane[], { from, to }: Span): string {
  if (!bars.length) return "";
  const busy = bars.reduce((sum, bar) => sum + ((bar.finished_at ?? to) - bar.started_at), 0);
  const slots = `${lanes.length} ${lanes.length === 1 ? "slot" : "slots"}`;
  return `${bars.length} attempts on ${slots} in ${duration(to - from)}; the slots were busy for ${percent(busy / (lanes.length * (to - from)))} of it.`;
}

function describe(bar: Bar): string {
  const took = bar.finished_at ? duration(bar.finished_at - bar.started_at) : "still running";
  const outcome = `attempt ${bar.number} ${WORDS[bar.outcome] ?? bar.outcome}${bar.code && ` (${bar.code})`}`;
  return [`${bar.step} · ${bar.key}`, outcome, took, `${bar.slot || "no slot"} of ${bar.worker}`].join("\n");
}

function s(tag: string, attributes: Record<string, string | number>, ...children: (Node | string)[]): SVGElement {
  const element = document.createElementNS(SVG, tag) as SVGElement;
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  element.append(...children);
  return element;
}

function picture(lanes: Lane[], steps: string[], span: Span, width: number, choose: Choose): SVGElement {
  const left = Math.min(150, Math.round(width * 0.24));
  const height = lanes.length * LANE_PX + AXIS_PX;
  const x = (at: number) => left + ((at - span.from) / (span.to - span.from)) * (width - left - 8);
  const title = `Attempts of the job over ${duration(span.to - span.from)}, by slot`;
  const svg = s("svg", { width, height, viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": title });
  svg.append(...ticks(span, x, height, width));
  lanes.forEach((lane, i) => {
    const name = s(
      "text",
      { x: left - 8, y: i * LANE_PX + LANE_PX / 2, class: "lane-name" },
      lane.short,
      s("title", {}, lane.name),
    );
    const bottom = (i + 1) * LANE_PX;
    svg.append(name, s("line", { x1: left, x2: width, y1: bottom, y2: bottom, class: "lane" }));
    for (const bar of lane.bars) svg.append(block(bar, i, steps, span, x, choose));
  });
  return svg;
}

function block(
  bar: Bar,
  lane: number,
  steps: string[],
  span: Span,
  x: (at: number) => number,
  choose: Choose,
): SVGElement {
  const from = x(bar.started_at);
  const to = x(bar.finished_at ?? span.to);
  const place = {
    x: from.toFixed(1),
    y: lane * LANE_PX + (LANE_PX - BAR_PX) / 2,
    width: Math.max(1.5, to - from - 0.5).toFixed(1),
  };
  const style = { height: BAR_PX, rx: 2, class: `bar ${colour(steps.indexOf(bar.step))}`, "data-outcome": bar.outcome };
  const rect = s("rect", { ...place, ...style }, s("title", {}, describe(bar)));
  rect.addEventListener("click", () => choose(bar));
  return rect;
}

/** About four round times below the lanes. */
function ticks({ from, to }: Span, x: (at: number) => number, height: number, width: number): SVGElement[] {
  const raw = (to - from) / Math.max(2, Math.min(8, width / 130));
  const unit = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((n) => n * unit).find((n) => n >= raw) ?? raw;
  const times = Array.from({ length: Math.floor((to - from) / step) + 1 }, (_, i) => i * step);
  return times.flatMap((t) => [
    s("line", { x1: x(from + t), x2: x(from + t), y1: 0, y2: height - AXIS_PX + 5, class: "tick" }),
    s(
      "text",
      { x: x(from + t), y: height - 6, class: "tick-name" },
      step < 1 ? `${t.toFixed(1)} s` : duration(t).replace(".0", ""),
    ),
  ]);
}

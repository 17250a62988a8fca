/** A job's attempts over time: a lane per slot, a bar per attempt, a colour per step. */

import { useEffect, useRef, useState } from "preact/hooks";
import type { Job } from "../api/schemas";
import { duration, percent } from "../ui/format";
import { Log, LogButton } from "./failures";
import { shortId } from "./fleet";
import type { Bar } from "./types";

const LANE_PX = 22;
const BAR_PX = 14;
const AXIS_PX = 26;
const COLOURS = 6;
const WORDS: Record<string, string> = {
  succeeded: "succeeded",
  running: "runs",
  failed: "failed",
  interrupted: "was interrupted",
  released: "was returned to the queue",
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

/** `now` by the server's clock. */
export function Timeline({ job, bars: all, now }: { job: Job; bars: Bar[]; now: number }) {
  const [chosen, setChosen] = useState<Bar | null>(null);
  const box = useRef<HTMLDivElement>(null);
  const width = useWidth(box);
  const bars = all.filter((bar) => bar.slot || bar.outcome !== "running"); // without a slot: not started yet
  const steps = job.steps.map((step) => step.name);
  const lanes = lanesOf(bars);
  const span = spanOf(bars, now);
  const used = job.steps.filter((step) => bars.some((bar) => bar.step === step.name));
  return (
    <div class="timeline">
      <div class="timeline-head">
        <p>{summary(bars, lanes, span)}</p>
      </div>
      <ul class="legend">
        {used.map((step) => (
          <li key={step.name} class={colour(steps.indexOf(step.name))}>
            <span>{step.title}</span>
          </li>
        ))}
      </ul>
      <div class="timeline-box" ref={box}>
        {lanes.length ? (
          <Picture lanes={lanes} steps={steps} span={span} width={width} onchoose={setChosen} />
        ) : (
          <p class="placeholder">Nothing has run yet.</p>
        )}
      </div>
      <div class="timeline-chosen">{chosen && <Chosen key={chosen.attempt_id} bar={chosen} />}</div>
    </div>
  );
}

function Chosen({ bar }: { bar: Bar }) {
  const [open, setOpen] = useState(true);
  return (
    <>
      <p>{describe(bar)}</p>
      <div class="actions">
        <LogButton open={open} setOpen={setOpen} />
      </div>
      {open && <Log attempt={bar.attempt_id} />}
    </>
  );
}

/** Width of an element, pixels, as it changes. */
function useWidth(box: { current: HTMLElement | null }): number {
  const [width, setWidth] = useState(600);
  useEffect(() => {
    if (!box.current) return;
    const observer = new ResizeObserver(() => setWidth(box.current?.clientWidth || 600));
    observer.observe(box.current);
    return () => observer.disconnect();
  }, []);
  return width;
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

interface PictureProps {
  lanes: Lane[];
  steps: string[];
  span: Span;
  width: number;
  onchoose(bar: Bar): void;
}

function Picture({ lanes, steps, span, width, onchoose }: PictureProps) {
  const left = Math.min(150, Math.round(width * 0.24));
  const height = lanes.length * LANE_PX + AXIS_PX;
  const x = (at: number) => left + ((at - span.from) / (span.to - span.from)) * (width - left - 8);
  const title = `Attempts of the job over ${duration(span.to - span.from)}, by slot`;
  return (
    <svg width={width} height={height} viewBox={`0 0 ${width} ${height}`} role="img" aria-label={title}>
      {ticks(span, width).map(([at, name]) => (
        <g key={name}>
          <line x1={x(at)} x2={x(at)} y1={0} y2={height - AXIS_PX + 5} class="tick" />
          <text x={x(at)} y={height - 6} class="tick-name">
            {name}
          </text>
        </g>
      ))}
      {lanes.map((lane, i) => (
        <g key={lane.name} transform={`translate(0 ${i * LANE_PX})`}>
          <text x={left - 8} y={LANE_PX / 2} class="lane-name">
            {lane.short}
            <title>{lane.name}</title>
          </text>
          <line x1={left} x2={width} y1={LANE_PX} y2={LANE_PX} class="lane" />
          {lane.bars.map((bar) => (
            // biome-ignore lint/a11y/noStaticElementInteractions: the same is in the list of tasks, by keyboard
            <rect
              key={bar.attempt_id}
              x={x(bar.started_at)}
              y={(LANE_PX - BAR_PX) / 2}
              width={Math.max(1.5, x(bar.finished_at ?? span.to) - x(bar.started_at) - 0.5)}
              height={BAR_PX}
              rx={2}
              class={`bar ${colour(steps.indexOf(bar.step))}`}
              data-outcome={bar.outcome}
              onClick={() => onchoose(bar)}
            >
              <title>{describe(bar)}</title>
            </rect>
          ))}
        </g>
      ))}
    </svg>
  );
}

/** About four round times, and their names. */
function ticks({ from, to }: Span, width: number): [at: number, name: string][] {
  const raw = (to - from) / Math.max(2, Math.min(8, width / 130));
  const unit = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((n) => n * unit).find((n) => n >= raw) ?? raw;
  return Array.from({ length: Math.floor((to - from) / step) + 1 }, (_, i) => {
    const t = i * step;
    return [from + t, step < 1 ? `${t.toFixed(1)} s` : duration(t).replace(".0", "")];
  });
}

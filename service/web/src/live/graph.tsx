/** A minute of latency, rate and drops, drawn by uPlot in the colours of the page. */

import { useEffect, useRef } from "preact/hooks";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { KEPT_S, type Second } from "./figures";

const ROUND = [50, 100, 150, 200, 300, 500, 1000, 2000, 5000, 10_000];
const LEAST_MS = 44;
const FONT = "11px system-ui, sans-serif";

export function Graph({ history, targetFps }: { history: readonly Second[]; targetFps: number }) {
  const host = useRef<HTMLDivElement>(null);
  const plot = useRef<uPlot>(null);
  const fps = useRef(targetFps);
  fps.current = targetFps;
  useEffect(() => {
    const element = host.current;
    if (!element) return;
    const size = () => ({ width: element.clientWidth || 600, height: element.clientHeight || 104 });
    const made = new uPlot({ ...options(element, () => fps.current), ...size() }, dataOf([]), element);
    plot.current = made;
    const observer = new ResizeObserver(() => made.setSize(size()));
    observer.observe(element);
    return () => {
      observer.disconnect();
      made.destroy();
    };
  }, []);
  useEffect(() => plot.current?.setData(dataOf(history)), [history, targetFps]);
  const label = "The last minute: latency, frame rate and dropped frames";
  return <div ref={host} class="live-graph" role="img" aria-label={label} />;
}

/** Age in seconds, share of dropped frames, frames a second, milliseconds in the service and in all. */
function dataOf(history: readonly Second[]): uPlot.AlignedData {
  const ages = history.map((_, i) => i + 0.5 - history.length);
  const dropped = history.map(({ offered, dropped }) => (offered && dropped ? Math.min(1, dropped / offered) : null));
  const of = (name: "fps" | "serverMs" | "glassMs") => history.map((second) => second[name]);
  return [ages, dropped, of("fps"), of("serverMs"), of("glassMs")];
}

function options(element: HTMLElement, targetFps: () => number): Omit<uPlot.Options, "width" | "height"> {
  const ink = (name: string) => () => getComputedStyle(element).getPropertyValue(`--${name}`);
  const wash = (name: string, share: number) => () => `color-mix(in srgb, ${ink(name)()} ${share}%, transparent)`;
  const line = (scale: string, name: string, width: number): uPlot.Series => ({
    scale,
    stroke: ink(name),
    width,
    points: { show: false },
  });
  const axis = { font: FONT, ticks: { show: false }, gap: 6 };
  return {
    legend: { show: false },
    cursor: { show: false },
    padding: [10, 0, 0, 0],
    scales: {
      x: { time: false, range: [-KEPT_S, 0] },
      ms: { range: (_plot, _least, most) => [0, ROUND.find((n) => n >= Math.max(LEAST_MS, 1.1 * most)) ?? most] },
      fps: { range: () => [0, Math.max(10, 1.15 * targetFps())] },
      share: { range: [0, 1] },
    },
    axes: [
      {
        ...axis,
        stroke: ink("soft"),
        size: 18,
        grid: { show: false },
        splits: () => [-KEPT_S, 0],
        values: () => [`${KEPT_S} s ago`, "now"],
      },
      {
        ...axis,
        scale: "ms",
        stroke: ink("soft"),
        size: 52,
        grid: { stroke: ink("rule"), width: 1 },
        splits: (plot) => [0, (plot.scales.ms?.max ?? 0) / 2, plot.scales.ms?.max ?? 0],
        values: (_plot, [zero, half, most]) => [String(zero), String(half), `${most} ms`],
      },
      {
        ...axis,
        scale: "fps",
        side: 1,
        stroke: ink("viridian"),
        size: 44,
        grid: { show: false },
        splits: () => [targetFps()],
        values: () => [`${targetFps()} fps`],
      },
    ],
    series: [
      {},
      { scale: "share", fill: wash("alarm", 55), points: { show: false }, paths: uPlot.paths.bars?.({ size: [0.8] }) },
      line("fps", "viridian", 1.5),
      line("ms", "ultramarine", 1.5),
      { ...line("ms", "vermilion", 2), fill: wash("vermilion", 12) },
    ],
  };
}

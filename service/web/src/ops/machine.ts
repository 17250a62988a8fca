/** The machine that answers: processors and memory with their last hour, and free disk space. */

import { type Child, fill, h } from "../ui/dom";
import { bytes, percent } from "../ui/format";
import type { Machine } from "./types";

const WIDTH = 240;
const HEIGHT = 36;
const SVG = "http://www.w3.org/2000/svg";

export function createMachine(): { element: HTMLElement; update(machine: Machine): void } {
  const tiles = h("dl", { class: "tiles machine" });
  return {
    element: tiles,
    update(machine) {
      const { samples } = machine;
      const last = samples.at(-1);
      const used = (memory: number) => memory / machine.memory_bytes;
      const cpus = `of ${machine.cpus} ${machine.cpus === 1 ? "processor" : "processors"}, ${machine.host}`;
      const cpu = samples.map((sample) => sample.cpu);
      const memory = samples.map((sample) => used(sample.memory_bytes));
      fill(tiles, [
        tile("Processors", last ? percent(last.cpu) : "", cpus, trend("Processors", cpu)),
        tile(
          "Memory",
          last ? percent(used(last.memory_bytes)) : "",
          `of ${bytes(machine.memory_bytes)}`,
          trend("Memory", memory),
        ),
        ...machine.disks.map((disk) =>
          tile(`Disk of ${disk.place}`, bytes(disk.free_bytes), `free of ${bytes(disk.size_bytes)}`),
        ),
      ]);
    },
  };
}

const tile = (name: string, value: string, more: string, chart?: SVGElement): Child =>
  h("div", { class: "tile" }, h("dt", {}, name), h("dd", {}, value, h("small", {}, more)), chart && h("dd", {}, chart));

/** A line over the samples; `values` are 0..1. */
function trend(name: string, values: number[]): SVGElement | undefined {
  if (values.length < 2) return undefined;
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", `0 0 ${WIDTH} ${HEIGHT}`);
  svg.setAttribute("class", "trend");
  svg.setAttribute("role", "img");
  const most = percent(Math.max(...values));
  svg.setAttribute("aria-label", `${name}, last ${Math.ceil(values.length / 6)} minutes: at most ${most}`);
  const line = document.createElementNS(SVG, "polyline");
  line.setAttribute("points", trendPoints(values));
  svg.append(line);
  return svg;
}

/** Points of the line from left to right; 1 is at the top. */
export function trendPoints(values: number[]): string {
  const step = WIDTH / (values.length - 1);
  const y = (value: number) => HEIGHT - 1 - (HEIGHT - 2) * Math.min(1, Math.max(0, value));
  return values.map((value, index) => `${(index * step).toFixed(1)},${y(value).toFixed(1)}`).join(" ");
}

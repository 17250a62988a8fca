/** The machine that answers: processors and memory with their last hour, and free disk space. */

import { bytes, percent } from "../ui/format";
import { Tile } from "./table";
import type { Machine } from "./types";

const WIDTH = 240;
const HEIGHT = 36;

export function MachineFigures({ machine }: { machine: Machine }) {
  const { samples, cpus, host, memory_bytes: memory, disks } = machine;
  const load = samples.map((sample) => sample.cpu);
  const used = samples.map((sample) => sample.memory_bytes / memory);
  const latest = (values: number[]) => (values.length ? percent(values.at(-1) ?? 0) : "");
  return (
    <dl class="tiles machine">
      <Tile
        name="Processors"
        value={latest(load)}
        more={`of ${cpus} ${cpus === 1 ? "processor" : "processors"}, ${host}`}
      >
        <Trend name="Processors" values={load} />
      </Tile>
      <Tile name="Memory" value={latest(used)} more={`of ${bytes(memory)}`}>
        <Trend name="Memory" values={used} />
      </Tile>
      {disks.map((disk) => (
        <Tile
          key={disk.place}
          name={`Disk of ${disk.place}`}
          value={bytes(disk.free_bytes)}
          more={`free of ${bytes(disk.size_bytes)}`}
        />
      ))}
    </dl>
  );
}

/** A line over the samples; `values` are 0..1. */
function Trend({ name, values }: { name: string; values: number[] }) {
  if (values.length < 2) return null;
  const label = `${name}, last ${Math.ceil(values.length / 6)} minutes: at most ${percent(Math.max(...values))}`;
  return (
    <svg viewBox={`0 0 ${WIDTH} ${HEIGHT}`} class="trend" role="img" aria-label={label}>
      <polyline points={trendPoints(values)} />
    </svg>
  );
}

/** Points of the line from left to right; 1 is at the top. */
export function trendPoints(values: number[]): string {
  const step = WIDTH / (values.length - 1);
  const y = (value: number) => HEIGHT - 1 - (HEIGHT - 2) * Math.min(1, Math.max(0, value));
  return values.map((value, index) => `${(index * step).toFixed(1)},${y(value).toFixed(1)}`).join(" ");
}

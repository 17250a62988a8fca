/** Places the stamps of a stroke along its samples. */

import type { Dynamics, Tip } from "../document/tip";
import { valueAt } from "./curves";
import { random } from "./noise";
import type { Sample } from "./strokes";

export interface Stamp {
  x: number;
  y: number;
  /** Half the long axis, px. */
  radius: number;
  /** Of the long axis, radians clockwise from the right. */
  angle: number;
  /** Most paint that the stamp leaves, 0..1. */
  opacity: number;
  /** Share of the missing paint that it adds, 0..1. */
  flow: number;
  /** Its distance from the start of the stroke, in widths of the stroke. */
  along: number;
}

/** Tilt at which the curves of tilt end, degrees: few pens report more. */
const FULL_TILT = 60;
/** Least distance between two stamps, px. */
const LEAST_PX = 0.4;
/** Share of the brush's size over which the direction of the path is averaged. */
const TURNING = 0.5;
const DEGREE = Math.PI / 180;

const used = ({ pressure, tilt }: Dynamics, sample: Sample): number =>
  valueAt(pressure, sample[2]) * Math.max(0, valueAt(tilt, (sample[3] ?? 0) / FULL_TILT));

/** The stamps of one stroke, in order, as its samples arrive. They do not depend on how the samples arrive. */
export class StampPath {
  private last: Sample | null = null;
  private count = 0;
  /** Distance to the next stamp, and from the start, px. */
  private left = 0;
  private done = 0;
  /** Averaged direction of the path. */
  private direction: [number, number] | null = null;

  constructor(
    private readonly tip: Tip,
    private readonly size: number,
    private readonly seed: number,
  ) {}

  /** Continue to a sample. */
  to(sample: Sample, stamp: (stamp: Stamp) => void): void {
    const from = this.last;
    this.last = sample;
    if (!from) {
      // the first stamp waits for a direction if it needs one
      if (this.tip.turn !== "path") this.left = this.put(sample, stamp);
      return;
    }
    const [dx, dy] = [sample[0] - from[0], sample[1] - from[1]];
    const length = Math.sqrt(dx * dx + dy * dy);
    if (!length) return;
    this.turn(dx / length, dy / length, length);
    let at = this.left;
    while (at <= length) {
      const here = between(from, sample, at / length);
      const start = this.done;
      this.done += at;
      at += this.put(here, stamp);
      this.done = start;
    }
    this.left = at - length;
    this.done += length;
  }

  /** The stroke has ended: a dot is one stamp. */
  end(stamp: (stamp: Stamp) => void): void {
    if (this.last && !this.count) this.put(this.last, stamp);
  }

  private turn(x: number, y: number, length: number): void {
    const share = Math.min(1, length / Math.max(1, TURNING * this.size));
    const [beforeX, beforeY] = this.direction ?? [x, y];
    this.direction = [beforeX + share * (x - beforeX), beforeY + share * (y - beforeY)];
  }

  /** Put a stamp; the distance to the next one, px. */
  private put(sample: Sample, stamp: (stamp: Stamp) => void): number {
    const { tip, size, seed } = this;
    const index = this.count++;
    const width = size * used(tip.size, sample) * (1 - tip.sizeJitter * random(seed, index, 1));
    const away = tip.scatter * width;
    if (width > 0)
      stamp({
        x: sample[0] + away * (2 * random(seed, index, 2) - 1),
        y: sample[1] + away * (2 * random(seed, index, 3) - 1),
        radius: width / 2,
        angle: this.angleOf(sample) + 2 * Math.PI * tip.angleJitter * (random(seed, index, 4) - 0.5),
        opacity: Math.min(1, used(tip.opacity, sample)),
        flow: Math.min(1, tip.flow * used(tip.flowBy, sample)),
        along: this.done / size,
      });
    return Math.max(LEAST_PX, tip.spacing * Math.max(width, 1));
  }

  private angleOf(sample: Sample): number {
    const { angle, turn } = this.tip;
    const own = angle * DEGREE;
    if (turn === "path" && this.direction) return own + Math.atan2(this.direction[1], this.direction[0]);
    return turn === "pen" ? own + (sample[4] ?? 0) * DEGREE : own;
  }
}

/** A sample between two others; the lean goes the shorter way round. */
function between(a: Sample, b: Sample, t: number): Sample {
  const mix = (i: 0 | 1 | 2 | 3) => (a[i] ?? 0) + t * ((b[i] ?? 0) - (a[i] ?? 0));
  const turn = ((((b[4] ?? 0) - (a[4] ?? 0) + 540) % 360) - 180) * t;
  return [mix(0), mix(1), mix(2), mix(3), (a[4] ?? 0) + turn];
}

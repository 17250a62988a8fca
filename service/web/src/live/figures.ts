/** Measurements of the page: one record a second, the last minute kept. */

export const KEPT_S = 60;

export interface Second {
  /** Answers shown per second. */
  fps: number;
  /** Median milliseconds from a frame captured to its answer drawn. */
  glassMs: number | null;
  /** Median milliseconds from frame received to answer sent, by the service's clock. */
  serverMs: number | null;
  /** Frames left out, here or by the service. */
  dropped: number;
  /** Frames that were captured. */
  offered: number;
  upBytes: number;
  downBytes: number;
}

export interface Figures {
  history: Second[];
  captured(): void;
  /** A frame was not sent, since the network or this machine is behind. */
  skipped(): void;
  sent(bytes: number): void;
  shown(answer: { glassMs: number; serverMs: number; bytes: number }): void;
  /** The service dropped frames. */
  heard(stats: { dropped: number }): void;
  /** Close the second and begin another. */
  second(): Second;
  /** Share of frames dropped in the last `seconds`, 0..1. */
  dropShare(seconds?: number): number;
}

export function createFigures(): Figures {
  const history: Second[] = [];
  let now = blank();
  let last = performance.now();

  return {
    history,
    captured() {
      now.offered += 1;
    },
    skipped() {
      now.dropped += 1;
    },
    sent(bytes) {
      now.upBytes += bytes;
    },
    shown({ glassMs, serverMs, bytes }) {
      now.glass.push(glassMs);
      now.server.push(serverMs);
      now.downBytes += bytes;
    },
    heard(stats) {
      now.dropped += stats.dropped;
    },
    second() {
      const seconds = (performance.now() - last) / 1000;
      const { glass, server, ...counts } = now;
      const closed = { ...counts, fps: glass.length / seconds, glassMs: median(glass), serverMs: median(server) };
      history.push(closed);
      if (history.length > KEPT_S) history.shift();
      last = performance.now();
      now = blank();
      return closed;
    },
    dropShare(seconds = 10) {
      const latest = history.slice(-seconds);
      const offered = total(latest, "offered");
      return offered ? Math.min(1, total(latest, "dropped") / offered) : 0;
    },
  };
}

function blank() {
  return { glass: [] as number[], server: [] as number[], dropped: 0, offered: 0, upBytes: 0, downBytes: 0 };
}

const total = (seconds: Second[], name: "dropped" | "offered"): number =>
  seconds.reduce((sum, second) => sum + second[name], 0);

function median(values: number[]): number | null {
  const sorted = Float64Array.from(values).sort();
  return sorted[sorted.length >> 1] ?? null;
}

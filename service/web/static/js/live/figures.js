/** What is measured on this side of the wire: a second at a time, the last minute kept. */

export const KEPT_S = 60;

/**
 * @typedef {object} Second
 * @property {number} fps answers shown
 * @property {number|null} glassMs median from a frame captured to its answer drawn
 * @property {number|null} serverMs median from frame received to answer sent, by the service's clock
 * @property {number} dropped frames left out, here or there
 * @property {number} offered frames that were captured
 * @property {number} upBytes, downBytes
 */

/** @returns {{captured(), skipped(), sent(bytes), shown({glassMs, serverMs, bytes}), heard(stats), second(): Second, history: Second[]}} */
export function createFigures() {
  const history = [];
  let now = blank();
  let last = performance.now();

  return {
    history,
    captured: () => (now.offered += 1),
    /** A frame was not sent, for the network or this machine is behind. */
    skipped: () => (now.dropped += 1),
    sent: (bytes) => (now.upBytes += bytes),
    shown({ glassMs, serverMs, bytes }) {
      now.glass.push(glassMs);
      now.server.push(serverMs);
      now.downBytes += bytes;
    },
    /** A `stats` message of the service. */
    heard: (stats) => (now.dropped += stats.dropped),
    /** Close the second and begin another. */
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
    /** Share of frames dropped in the last `seconds`, 0..1. */
    dropShare(seconds = 10) {
      const recent = history.slice(-seconds);
      const offered = total(recent, "offered");
      return offered ? Math.min(1, total(recent, "dropped") / offered) : 0;
    },
  };
}

const blank = () => ({ glass: [], server: [], dropped: 0, offered: 0, upBytes: 0, downBytes: 0 });
const total = (seconds, name) => seconds.reduce((sum, second) => sum + second[name], 0);

function median(values) {
  if (!values.length) return null;
  const sorted = Float64Array.from(values).sort();
  return sorted[sorted.length >> 1];
}

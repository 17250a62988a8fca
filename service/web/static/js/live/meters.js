/** The figures under the picture: a number each, and the graph of the last minute. */

import { h } from "../dom.js";
import { createGraph } from "./graph.js";

const none = "–";
const ms = (value) => (value === null || value === undefined ? none : String(Math.round(value)));
const bits = (bytes) => `${((8 * bytes) / 1e6).toFixed(1)}`;

/** @returns {{element, show(second, figures, targetFps), heard(stats), codecs(text), clear()}} */
export function createMeters() {
  const tiles = {
    fps: tile("Rate", "fps", "viridian", "Painted frames that were shown in the last second."),
    glass: tile("Delay", "ms", "vermilion", "From the camera's frame to its painting on this screen: the median of the last second."),
    server: tile("Service", "ms", "ultramarine", "What the service adds: from a frame received to its answer sent."),
    drops: tile("Dropped", "%", "alarm", "Frames of the last ten seconds that were left out so that the delay does not grow: here, or by the service."),
    size: tile("Painted at", "", "", "The size at which the service paints now; it steps down when frames take too long."),
  };
  const graph = createGraph();
  const details = h("dl", { class: "pairs" });
  const more = h("details", { class: "live-more" }, h("summary", {}, "Where the time goes"), details);
  const element = h("div", { class: "live-meters" }, h("dl", { class: "live-tiles" }, Object.values(tiles).map((each) => each.element)), graph.element, more);
  const seen = {};

  function pairs() {
    const { codecs, stages = {}, up, down, scale } = seen;
    const rows = [
      ["Codecs", codecs],
      ["Network", up !== undefined && `${bits(up)} Mbit/s up, ${bits(down)} Mbit/s down`],
      ["Scale", scale && `${Math.round(scale * 100)} %`],
      ...Object.entries(stages).map(([name, value]) => [STAGES[name] ?? name, `${value.toFixed(1)} ms`]),
    ];
    details.replaceChildren(...rows.filter(([, value]) => value).map(([name, value]) => h("div", {}, h("dt", {}, name), h("dd", {}, value))));
  }

  return {
    element,
    show(second, figures, targetFps) {
      tiles.fps.set(second.offered ? second.fps.toFixed(second.fps < 9.95 ? 1 : 0) : none);
      tiles.glass.set(ms(second.glassMs));
      tiles.server.set(ms(second.serverMs));
      tiles.drops.set((100 * figures.dropShare()).toFixed(figures.dropShare() > 0 && figures.dropShare() < 0.1 ? 1 : 0));
      Object.assign(seen, { up: second.upBytes, down: second.downBytes });
      pairs();
      graph.draw(figures.history, targetFps);
    },
    /** A `stats` or `resolution` message. */
    heard({ width, height, scale, stages_ms: stages }) {
      tiles.size.set(`${width} × ${height}`);
      Object.assign(seen, { scale, ...(stages && { stages }) });
    },
    codecs: (text) => (seen.codecs = text),
    clear() {
      Object.values(tiles).forEach((each) => each.set(none));
      graph.draw([], 30);
    },
  };
}

const STAGES = { wait: "Waiting its turn", decode: "Decoding", look: "Looking: motion and importance", paint: "Painting", encode: "Encoding" };

function tile(title, unit, ink, about) {
  const number = h("span", { class: "live-number" }, none);
  const element = h("div", { class: "live-tile", title: about, ...(ink && { "data-ink": ink }) }, h("dt", {}, title), h("dd", {}, number, unit && h("small", {}, unit)));
  return { element, set: (text) => (number.textContent = text) };
}

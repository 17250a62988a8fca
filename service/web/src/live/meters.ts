/** The figures under the picture: one number each, and the graph of the last minute. */

import { h } from "../ui/dom";
import type { Figures, Second } from "./figures";
import { createGraph } from "./graph";
import { sizeSentence } from "./size-sentence";
import type { SizeReason } from "./types";

const NONE = "–";
const ms = (value: number | null): string => (value === null ? NONE : String(Math.round(value)));
const megabits = (bytes: number): string => `${((8 * bytes) / 1e6).toFixed(1)}`;

/** Of a `stats` or `resolution` message. */
interface Painted {
  width: number;
  height: number;
  scale: number;
  size?: SizeReason;
  stages_ms?: Record<string, number>;
}

export interface Meters {
  element: HTMLElement;
  show(second: Second, figures: Figures, targetFps: number): void;
  heard(painted: Painted): void;
  codecs(text: string): void;
  clear(): void;
}

export function createMeters(): Meters {
  const tiles = {
    fps: tile("Rate", "fps", "viridian", "Painted frames shown in the last second."),
    glass: tile(
      "Delay",
      "ms",
      "vermilion",
      "From the camera's frame to its painting on this screen: the median of the last second.",
    ),
    server: tile("Service", "ms", "ultramarine", "Time in the service: from a frame received to its answer sent."),
    drops: tile(
      "Dropped",
      "%",
      "alarm",
      "Frames of the last ten seconds that were left out, by this page or by the service, so that the delay does not grow.",
    ),
    size: tile(
      "Painted at",
      "",
      "",
      "The size at which the service paints now; it is reduced when frames take too long.",
    ),
  };
  const graph = createGraph();
  const details = h("dl", { class: "pairs" });
  const more = h("details", { class: "live-more" }, h("summary", {}, "Time of each stage"), details);
  const row = h(
    "dl",
    { class: "live-tiles" },
    Object.values(tiles).map((each) => each.element),
  );
  const why = h("p", { class: "live-why", role: "status" });
  const element = h("div", { class: "live-meters" }, row, why, graph.element, more);
  const latest: { codecs?: string; stages?: Record<string, number>; up?: number; down?: number; scale?: number } = {};

  function pairs(): void {
    const { codecs, stages = {}, up, down = 0, scale } = latest;
    const rows: [string, string | undefined][] = [
      ["Codecs", codecs],
      ["Network", up === undefined ? "" : `${megabits(up)} Mbit/s up, ${megabits(down)} Mbit/s down`],
      ["Scale", scale ? `${Math.round(scale * 100)} %` : ""],
      ...Object.entries(stages).map(([name, value]): [string, string] => [
        STAGES[name] ?? name,
        `${value.toFixed(1)} ms`,
      ]),
    ];
    const shown = rows.flatMap(([name, value]) => (value ? [h("div", {}, h("dt", {}, name), h("dd", {}, value))] : []));
    details.replaceChildren(...shown);
  }

  return {
    element,
    show(second, figures, targetFps) {
      const share = figures.dropShare();
      tiles.fps.set(second.offered ? second.fps.toFixed(second.fps < 9.95 ? 1 : 0) : NONE);
      tiles.glass.set(ms(second.glassMs));
      tiles.server.set(ms(second.serverMs));
      tiles.drops.set((100 * share).toFixed(share > 0 && share < 0.1 ? 1 : 0));
      Object.assign(latest, { up: second.upBytes, down: second.downBytes });
      pairs();
      graph.draw(figures.history, targetFps);
    },
    heard({ width, height, scale, size, stages_ms: stages }) {
      tiles.size.set(`${width} × ${height}`);
      if (size) setText(why, sizeSentence(scale, size));
      Object.assign(latest, { scale, ...(stages && { stages }) });
    },
    codecs(text) {
      latest.codecs = text;
    },
    clear() {
      for (const each of Object.values(tiles)) each.set(NONE);
      setText(why, "");
      graph.draw([], 30);
    },
  };
}

/** Stages by their names in the protocol. */
const STAGES: Record<string, string> = {
  wait: "Queued",
  decode: "Decoding",
  analyze: "Analysis: motion and importance",
  paint: "Painting",
  filter: "Removing flicker",
  encode: "Encoding",
};

/** A status is read out whenever its text is set, so only changes are. */
function setText(element: HTMLElement, text: string): void {
  if (element.textContent !== text) element.textContent = text;
}

function tile(title: string, unit: string, ink: string, about: string) {
  const number = h("span", { class: "live-number" }, NONE);
  const value = h("dd", {}, number, unit && h("small", {}, unit));
  const element = h(
    "div",
    { class: "live-tile", title: about, ...(ink && { "data-ink": ink }) },
    h("dt", {}, title),
    value,
  );
  return {
    element,
    set(text: string) {
      number.textContent = text;
    },
  };
}

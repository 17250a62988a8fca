/** The quality report of a finished job: its figures, and flicker over time. A bar shows its frame in the player. */

import * as api from "../api/api";
import type { Job } from "../api/schemas";
import { h } from "../ui/dom";
import { notify } from "../ui/notices";

interface Sample {
  frame: number;
  flicker: number;
  detail: number;
  structure: number;
}

export interface Quality {
  pairs: number;
  flicker: number | null;
  detail: number | null;
  structure: number | null;
  edge_width_px?: number | null;
  /** Faces found in the source; null: they were not searched. */
  faces?: number | null;
  faces_kept?: number | null;
  palette_distance?: number;
  flicker_of_alone?: number;
  samples: Sample[];
  worst: number[];
}

type Row = [title: string, value: string, meaning: string];

/** An element that fills itself; nothing if the job was not asked for a report. */
export function createQuality(job: Job, showFrame: (frame: number) => void): HTMLElement | null {
  if (!job.request.output?.report) return null;
  const element = h("section", { class: "quality", "aria-label": "Quality" });
  api
    .get<{ quality?: Quality }>(api.paths.file(job.id, "report"))
    .then(({ quality }) => quality?.pairs && element.append(...content(quality, showFrame)))
    .catch(notify);
  return element;
}

function content(quality: Quality, showFrame: (frame: number) => void): HTMLElement[] {
  const cells = rows(quality).map(([title, value, meaning]) =>
    h("div", {}, h("dt", {}, title), h("dd", {}, h("strong", {}, value), " ", h("small", {}, meaning))),
  );
  return [
    h("h2", {}, "Quality"),
    h("dl", { class: "quality-figures" }, cells),
    ...notesOnFaces(quality).map((note) => h("p", {}, note)),
    h("p", {}, `Flicker of ${count(quality.pairs, "measured frame")}. Select a bar to see its frame.`),
    chart(quality, showFrame),
    worstMoments(quality, showFrame),
  ];
}

const count = (n: number, thing: string): string => `${n} ${thing}${n === 1 ? "" : "s"}`;

/** The figures that were measured, in words. */
export function rows(quality: Quality): Row[] {
  const all: [string, number | null | undefined, string, string][] = [
    ["Flicker", quality.flicker, "", "1 = as steady as the source, less is steadier"],
    ["Detail", quality.detail, "", "1 = as much as the source"],
    ["Structure", quality.structure, "", "1 = the scene reads as in the source"],
    ["Edge width", quality.edge_width_px, " px", "1 to 2 px = drawn at this size"],
    ["Flicker, of frame by frame", quality.flicker_of_alone, "", "1 = as much as frames painted one by one"],
    ["Palette distance", quality.palette_distance, "", "0 = only colours of the style, of 442"],
    ["Faces kept", quality.faces_kept, "", `of ${quality.faces ?? 0} faces found in the source`],
  ];
  return all.flatMap(([title, value, unit, meaning]): Row[] =>
    value === null || value === undefined ? [] : [[title, `${value.toFixed(2)}${unit}`, meaning]],
  );
}

/** Why there is no share of faces kept, if so. */
export function notesOnFaces({ faces }: Quality): string[] {
  if (faces === null) return ["Faces were not searched: that takes too long beside so short a render."];
  return faces === 0 ? ["No frontal face was found in the source."] : [];
}

/** Buttons that show the frames with the most flicker. */
function worstMoments({ worst, samples }: Quality, showFrame: (frame: number) => void): HTMLElement {
  const flicker = new Map(samples.map((sample) => [sample.frame, sample.flicker]));
  const buttons = worst.map((frame) =>
    h(
      "button",
      { type: "button", class: "chip-button", onclick: () => showFrame(frame) },
      `Frame ${frame + 1} · ${(flicker.get(frame) ?? 0).toFixed(2)}`,
    ),
  );
  const label = h("span", {}, "Most flicker:");
  return h(
    "div",
    { class: "quality-worst", role: "group", "aria-label": "Frames with the most flicker" },
    label,
    buttons,
  );
}

function chart(quality: Quality, showFrame: (frame: number) => void): HTMLElement {
  const most = Math.max(1, ...quality.samples.map((sample) => sample.flicker));
  const worst = new Set(quality.worst);
  const bars = quality.samples.map((sample) => {
    const name = `Frame ${sample.frame + 1}: flicker ${sample.flicker.toFixed(2)}`;
    const bar = h("button", {
      type: "button",
      class: worst.has(sample.frame) ? "quality-bar worst" : "quality-bar",
      title: name,
      "aria-label": name,
      onclick: () => showFrame(sample.frame),
    });
    bar.style.setProperty("--share", String(sample.flicker / most));
    return bar;
  });
  return h("div", { class: "quality-chart", role: "group", "aria-label": "Flicker over time" }, bars);
}

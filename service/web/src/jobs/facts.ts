/** Folded sections of the job page: the settings used, the time of each stage, and the same job by link or command. */

import * as api from "../api/api";
import type { Job, Params, Step } from "../api/schemas";
import { type Child, h } from "../ui/dom";
import { duration, humanise } from "../ui/format";
import { announce, notify } from "../ui/notices";
import { ownLabels } from "./job-list";
import { commandLine, curlLine, pythonLine } from "./recipes";

export function createFacts(job: Job): HTMLElement {
  const stages = job.steps.filter((step) => Object.keys(step.stages ?? {}).length);
  return h(
    "div",
    { class: "facts" },
    details("Settings", settings(job), inputPictures(job)),
    stages.length > 0 && details("Timings", stages.flatMap(timings)),
    copies(job),
  );
}

function details(title: string, rows: Child[], ...more: Child[]): HTMLElement {
  return h(
    "details",
    { class: "group" },
    h("summary", {}, h("span", {}, title)),
    more,
    h("dl", { class: "pairs" }, rows),
  );
}

const pair = (name: string, value: Child): HTMLElement => h("div", {}, h("dt", {}, name), h("dd", {}, value));

function settings(job: Job): Child[] {
  const { id, request, created_at: created, finished_at: finished } = job;
  const params = request.method === "layers" ? layers(request.params) : rows(request.params);
  const output = request.output ?? {};
  return [
    pair("Method", humanise(request.method)),
    ...(params.length ? params : [pair("Parameters", "defaults")]),
    request.frames ? pair("Frames", `${request.frames[0] + 1} to ${request.frames[1]}`) : null,
    pair("Seed", String(request.seed ?? 0)),
    output.format ? pair("Format", output.format.toUpperCase()) : null,
    finished ? pair("Took", duration(finished - created)) : null,
    ...ownLabels(job).map((label) => pair("Label", label)),
    pair("Job", h("code", {}, id)),
  ];
}

const rows = (params: Params): Child[] =>
  Object.entries(params ?? {}).map(([name, value]) => pair(humanise(name), plain(value)));

/** The layers of a job that has several, the topmost first. */
function layers(params: Params): Child[] {
  const listed = (Array.isArray(params.layers) ? params.layers : []) as Params[];
  const of = ({ method, opacity, blend }: Params) =>
    [humanise(String(method)), `${Math.round(100 * Number(opacity ?? 1))} %`, blend === "over" ? "" : blend]
      .filter(Boolean)
      .join(", ");
  return listed.map((layer, i) => pair(`Layer ${i + 1}`, of(layer))).reverse();
}

/** The pictures that the job was given besides its video, for example the painting. */
function inputPictures(job: Job): Child {
  const others = Object.entries(job.request.inputs).filter(([name]) => name !== "video");
  if (!others.length) return false;
  return h(
    "div",
    { class: "fact-inputs" },
    others.map(([name, id]) => inputPicture(name, id)),
  );
}

function inputPicture(name: string, id: string): HTMLElement {
  const figure = h("figure", {}, h("figcaption", {}, humanise(name)));
  api.asset(id).then(async (asset) => {
    if (asset.kind !== "image" && asset.kind !== "video") return;
    const src = await api.objectUrl(api.paths.frame(id, 0, 240));
    figure.prepend(h("img", { src, alt: asset.filename }));
  }, notify);
  return figure;
}

const plain = (value: unknown): string => (typeof value === "object" ? JSON.stringify(value) : String(value));
const timings = (step: Step): HTMLElement[] => [
  ...Object.entries(step.stages).map(([stage, seconds]) =>
    pair(`${step.title}: ${humanise(stage).toLowerCase()}`, duration(seconds)),
  ),
  ...(step.cpu_s ? [pair(`${step.title}: processor time`, duration(step.cpu_s))] : []),
  ...(step.peak_bytes ? [pair(`${step.title}: largest memory`, `${Math.round(step.peak_bytes / 1e6)} MB`)] : []),
];

function copies(job: Job): HTMLElement {
  const ways: [string, string][] = [
    ["Link", location.href],
    ["curl", curlLine(job, location.origin)],
    ["Python", pythonLine(job, location.origin)],
    ["Command", commandLine(job)],
  ];
  const button = ([title, text]: [string, string]) =>
    h("button", { type: "button", class: "button small", onclick: () => copy(title, text) }, title);
  return h(
    "div",
    { class: "copies", role: "group", "aria-label": "Copy this job as" },
    h("span", {}, "Copy as"),
    ways.map(button),
  );
}

async function copy(title: string, text: string): Promise<void> {
  try {
    await navigator.clipboard.writeText(text);
    announce(`${title} copied.`);
  } catch {
    notify(
      new api.Problem({
        title: "Not copied",
        detail: text,
        remedy: "The browser does not allow it here: mark the text and copy it.",
      }),
    );
  }
}

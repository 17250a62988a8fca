/** What a job was asked to do and how long its parts took: folded away, for those who want to know. */

import { h } from "./dom.js";
import { duration, humanise } from "./format.js";

export function createFacts(job) {
  const stages = job.steps.filter((step) => Object.keys(step.stages ?? {}).length);
  return h(
    "div",
    { class: "facts" },
    details("Settings", settings(job)),
    stages.length > 0 && details("Timings", stages.flatMap((step) => timings(step))),
  );
}

const details = (title, rows) => h("details", { class: "group" }, h("summary", {}, h("span", {}, title)), h("dl", { class: "pairs" }, rows));
const pair = (name, value) => h("div", {}, h("dt", {}, name), h("dd", {}, value));

function settings({ id, request, created_at: created, finished_at: finished }) {
  const params = Object.entries(request.params ?? {}).map(([name, value]) => pair(humanise(name), plain(value)));
  const output = request.output ?? {};
  return [
    pair("Method", humanise(request.method)),
    ...(params.length ? params : [pair("Parameters", "defaults")]),
    pair("Seed", String(request.seed ?? 0)),
    output.format && pair("Format", output.format.toUpperCase()),
    finished && pair("Took", duration(finished - created)),
    pair("Job", h("code", {}, id)),
  ];
}

const plain = (value) => (typeof value === "object" ? JSON.stringify(value) : String(value));
const timings = (step) => Object.entries(step.stages).map(([stage, seconds]) => pair(`${step.title}: ${humanise(stage).toLowerCase()}`, duration(seconds)));

/** Films of several jobs side by side in the wipe, for example of a project's variants. */

import * as api from "../api/api";
import type { Job } from "../api/schemas";
import type { View } from "../ui/dom";
import { fill, h } from "../ui/dom";
import { percent } from "../ui/format";
import { notify, problemBlock } from "../ui/notices";
import { createPlayer } from "./player";
import { isFinal, stateWord } from "./progress";

const POLL_MS = 1500;

export function createComparePage(ids: string[]): View {
  const stage = h("div", { class: "result" });
  const list = h("ul", { class: "compare-list" });
  const left = choice("Left film");
  const right = choice("Right film");
  const choices = h("div", { class: "compare-choices" }, left.element, right.element);
  const element = h("div", { class: "compare-page" }, h("h1", {}, "Compare films"), choices, stage, list);
  const controller = new AbortController();
  let timer = 0;
  let jobs: Job[] = [];
  let shown = "";
  let close = () => {};

  left.select.addEventListener("change", show);
  right.select.addEventListener("change", show);
  load();

  async function load(): Promise<void> {
    try {
      jobs = await Promise.all(ids.map((id) => api.job(id, controller.signal)));
    } catch (error) {
      if (!api.isAbort(error)) fill(element, problemBlock(api.asProblem(error)));
      return;
    }
    const finished = jobs.filter((job) => job.state === "succeeded" && playable(job));
    left.offer(finished, 0);
    right.offer(finished, 1);
    fill(list, jobs.map(entry));
    show();
    if (jobs.some((job) => !isFinal(job))) timer = window.setTimeout(load, POLL_MS);
  }

  function show(): void {
    const pair = [left.select.value, right.select.value].map((id) => jobs.find((job) => job.id === id));
    const [one, other] = pair;
    choices.hidden = !one || !other;
    if (!one || !other) {
      if (!shown)
        fill(stage, h("p", { class: "compare-wait", role: "status" }, "Two films are needed for a comparison."));
      return;
    }
    const wanted = `${one.id} ${other.id}`;
    if (wanted === shown) return;
    shown = wanted;
    close();
    play(one, other).catch(notify);
  }

  async function play(one: Job, other: Job): Promise<void> {
    const asset = await api.asset(one.request.inputs.video ?? "");
    const [before, after] = await Promise.all([one, other].map((job) => api.mediaUrl(api.paths.result(job.id))));
    if (controller.signal.aborted || shown !== `${one.id} ${other.id}`) return;
    const labels: [string, string] = [shortName(one), shortName(other)];
    const player = createPlayer({ asset, before: before ?? "", after: after ?? "", poster: null, first: 0, labels });
    close = player.close;
    fill(stage, player.element);
  }

  return {
    element,
    close() {
      controller.abort();
      clearTimeout(timer);
      close();
    },
  };
}

const playable = (job: Job): boolean => ["mp4", "webm"].includes(job.request.output?.format ?? "mp4");

/** The variant's name, which is the last part of the job's. */
const shortName = (job: Job): string => (job.request.name ?? "").split(": ").at(-1) || job.request.method;

function entry(job: Job): HTMLElement {
  const state = isFinal(job) ? stateWord(job) : `${stateWord(job)}, ${percent(job.progress)}`;
  const link = h("a", { href: `#/jobs/${job.id}` }, job.request.name || job.request.method);
  return h("li", {}, link, h("span", {}, playable(job) ? state : `${state}: only MP4 and WebM can be compared`));
}

interface Choice {
  element: HTMLElement;
  select: HTMLSelectElement;
  /** Offer these films; the one at `index` is chosen if none is. */
  offer(jobs: Job[], index: number): void;
}

function choice(label: string): Choice {
  const select = h("select", {});
  return {
    element: h("label", { class: "inline-field" }, label, select),
    select,
    offer(jobs, index) {
      const chosen = select.value;
      fill(
        select,
        jobs.map((job) => h("option", { value: job.id }, shortName(job))),
      );
      select.value = jobs.some((job) => job.id === chosen) ? chosen : (jobs[index]?.id ?? "");
    },
  };
}

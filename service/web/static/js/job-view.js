/** One job: how it comes along while it runs, and the player when it is done. */

import * as api from "./api.js";
import { hashOfJob } from "./draft.js";
import { fill, h } from "./dom.js";
import { follow } from "./events.js";
import { ago, percent } from "./format.js";
import { createEasel } from "./easel.js";
import { createFacts } from "./facts.js";
import { deletion } from "./jobs.js";
import { notify, problemBlock } from "./notices.js";
import { createProgress, isFinal, stateWord } from "./progress.js";
import { createResult } from "./result.js";

const REFRESH_MS = 600;

/** @returns {{element, close()}} */
export function createJobView(id) {
  const element = h("div", { class: "job", "aria-busy": "true" }, h("div", { class: "loading" }, "Fetching the work…"));
  const life = new AbortController();
  const progress = createProgress();
  const easel = createEasel(id);
  let result = null;
  let job = null;
  let drawn = "";

  async function refresh() {
    try {
      draw(await api.job(id, life.signal));
    } catch (problem) {
      if (!life.signal.aborted && !job) missing(problem);
    }
  }

  function missing(problem) {
    life.abort();
    element.setAttribute("aria-busy", "false");
    fill(element, h("div", { class: "failure" }, problemBlock(problem, h("a", { class: "button", href: "#/jobs" }, "All works"), h("a", { class: "button", href: "#/" }, "To the studio"))));
  }

  function draw(now) {
    job = now;
    document.title = `${isFinal(now) ? stateWord(now) : percent(now.progress)} · ${titleOf(now)} · Impasto`;
    progress.update(now);
    easel.update(now);
    if (drawn !== now.state) compose(now);
    drawn = now.state;
  }

  /** Lay the page out for the job's state. */
  function compose(now) {
    element.setAttribute("aria-busy", "false");
    result?.close();
    result = now.state === "succeeded" ? createResult(now) : null;
    const side = h("aside", { class: "panel job-panel", "aria-label": "Progress" }, now.error && problemBlock({ title: "It failed", message: now.error.message, remedy: now.error.remedy }), result?.downloads, progress.element, h("div", { class: "actions" }, verbs(now)), createFacts(now));
    fill(element, h("div", { class: "studio" }, h("div", { class: "studio-stage" }, heading(now), result?.element ?? easel.element), side));
  }

  function verbs(now) {
    const button = (verb, text, kind = "") => h("button", { type: "button", class: `button ${kind}`, onclick: () => act(verb) }, text);
    const again = h("a", { class: "button", href: hashOfJob(now) }, "Change settings");
    if (now.state === "paused") return [button("resume", "Go on", "primary"), button("cancel", "Cancel")];
    if (!isFinal(now)) return [button("pause", "Pause"), button("cancel", "Cancel")];
    const forget = deletion(id, titleOf(now), () => (location.hash = "#/jobs"));
    return [now.state !== "succeeded" && button("retry", "Try again", "primary"), again, forget];
  }

  async function act(verb) {
    element.querySelectorAll(".actions button").forEach((button) => (button.disabled = true));
    await api.act(id, verb).then(draw, notify);
    element.querySelectorAll(".actions button").forEach((button) => (button.disabled = false));
    if (verb === "retry") watch();
  }

  /** Read the job anew after each event, but not more often than the eye can follow. */
  async function watch() {
    const stop = new AbortController();
    life.signal.addEventListener("abort", () => stop.abort(), { once: true });
    const soon = throttle(async () => {
      await refresh();
      if (job && isFinal(job)) stop.abort();
    }, REFRESH_MS);
    await follow(id, soon, stop.signal);
  }

  refresh().then(() => job && !isFinal(job) && watch());
  return {
    element,
    close() {
      life.abort();
      easel.close();
      result?.close();
    },
  };
}

const titleOf = (job) => job.request.name || job.request.method;

const heading = (job) => h("div", { class: "film-head" }, h("div", { class: "film-title" }, h("h1", {}, titleOf(job)), h("p", {}, `${stateWord(job)} · begun ${ago(job.created_at)}`)));

/** Run `work` at once, then at most once every `ms`; a call meanwhile is made up for at the end. */
function throttle(work, ms) {
  let waiting = false;
  let again = false;
  const run = async () => {
    if (waiting) return void (again = true);
    waiting = true;
    again = false;
    await work();
    setTimeout(() => ((waiting = false), again && run()), ms);
  };
  return run;
}

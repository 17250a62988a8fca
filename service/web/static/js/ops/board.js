/** The board: every part of the page, looked at again every two seconds while somebody can see it. */

import * as api from "../api.js";
import { h } from "../dom.js";
import * as ops from "./api.js";
import { createFailures } from "./failures.js";
import { createFigures } from "./figures.js";
import { createNodes, createWorkers } from "./fleet.js";
import { createTimeline } from "./timeline.js";
import { createLive, createWorks } from "./works.js";

const EVERY_MS = 2000;
const LONGEST_MS = 15_000;
const STATES = ["", "queued", "running", "paused", "failed", "cancelled", "succeeded"];

/** @param {object} first what was seen at the start @param {(problem) => void} ondenied the key is no admin's (any more) */
export function createBoard(first, ondenied) {
  const life = new AbortController();
  const chosen = { job: new URLSearchParams(location.hash.slice(1)).get("job"), state: "" };
  const parts = make({ again: () => refresh(), onjob: choose });
  const filter = h("select", { "aria-label": "Jobs to show", onchange: () => ((chosen.state = filter.value), refresh()) }, STATES.map((state) => h("option", { value: state }, state || "all states")));
  const late = h("p", { class: "late", role: "status", hidden: true });
  const timeline = section("timeline", "Timeline", parts.timeline.element);
  timeline.hidden = true;
  const element = h(
    "div",
    { class: "board" },
    h("div", { class: "board-head" }, h("h1", {}, "Operations"), late),
    parts.figures.element,
    section("workers", "Workers", parts.workers.element),
    section("machines", "Machines", parts.nodes.element),
    section("jobs", "Jobs", filter, parts.works.element),
    timeline,
    section("failures", "Failures", parts.failures.element),
    section("live", "Live sessions", parts.live.element),
  );
  let timer = 0;
  let pause = EVERY_MS;
  let turn = 0;

  function show(look) {
    parts.figures.update(look);
    parts.workers.update(look.workers);
    parts.nodes.update(look.nodes);
    parts.works.update(look.jobs);
    parts.failures.update(look.failures);
    parts.live.update(look.live);
    late.hidden = true;
    pause = EVERY_MS;
  }

  async function refresh() {
    const mine = ++turn;
    clearTimeout(timer);
    try {
      const look = await ops.look(chosen.state, life.signal);
      if (mine === turn) show(look);
      if (mine === turn && chosen.job) await showTimeline(look.snapshot.at);
    } catch (problem) {
      if (life.signal.aborted) return;
      if (problem.status === 403) return ondenied(problem);
      complain(problem);
    }
    if (mine === turn && !document.hidden) timer = setTimeout(refresh, pause);
  }

  function complain(problem) {
    if (!(problem instanceof api.Problem)) console.error(problem);
    late.textContent = `What you see is old: ${problem.message}`;
    late.hidden = false;
    pause = Math.min(LONGEST_MS, 2 * pause);
  }

  async function showTimeline(now) {
    const id = chosen.job;
    try {
      const [job, bars] = await Promise.all([api.job(id, life.signal), ops.timeline(id, life.signal)]);
      if (id !== chosen.job) return;
      timeline.hidden = false;
      timeline.querySelector("h2").textContent = `Timeline of ${job.request.name || job.request.method}, ${job.state}`;
      parts.timeline.update(job, bars, now);
    } catch (problem) {
      if (problem.status !== 404) throw problem;
      chosen.job = null;
      timeline.hidden = true;
    }
  }

  function choose(id) {
    chosen.job = id;
    history.replaceState(null, "", `#job=${encodeURIComponent(id)}`);
    refresh().then(() => timeline.scrollIntoView({ behavior: "smooth", block: "nearest" }));
  }

  const seen = () => (document.hidden ? clearTimeout(timer) : refresh());
  document.addEventListener("visibilitychange", seen, { signal: life.signal });
  show(first);
  refresh();
  return { element, close: () => (life.abort(), clearTimeout(timer)) };
}

function make(calls) {
  return {
    figures: createFigures(calls),
    workers: createWorkers(calls),
    nodes: createNodes(calls),
    works: createWorks(calls),
    timeline: createTimeline(),
    failures: createFailures(calls),
    live: createLive(calls),
  };
}

function section(id, title, ...children) {
  return h("section", { class: "part", id, "aria-labelledby": `${id}-title` }, h("h2", { id: `${id}-title` }, title), children);
}

/** The board: every part of the page, refreshed every two seconds while the tab is visible. */

import * as api from "../api/api";
import type { View } from "../ui/dom";
import { type Child, h } from "../ui/dom";
import * as ops from "./api";
import { createFailures } from "./failures";
import { createFigures } from "./figures";
import { createNodes, createWorkers } from "./fleet";
import { createJobs, createLive } from "./jobs";
import { createMachine } from "./machine";
import { createTimeline } from "./timeline";
import type { BoardCalls, Overview } from "./types";

const EVERY_MS = 2000;
const LONGEST_MS = 15_000;
/** Pause in typing after which a search begins. */
const TYPING_MS = 250;
const STATES: ops.JobState[] = ["", "queued", "running", "paused", "failed", "cancelled", "succeeded"];

/** `first`: the overview read at the start; `ondenied` is called when the key is no admin's (any more). */
export function createBoard(first: Overview, ondenied: (problem: api.Problem) => void): View {
  const controller = new AbortController();
  const chosen: ops.JobFilter & { job: string | null } = {
    job: new URLSearchParams(location.hash.slice(1)).get("job"),
    state: "",
    search: "",
  };
  const parts = createParts({ again: () => refresh(), onjob: choose });
  const options = STATES.map((state) => h("option", { value: state }, state || "all states"));
  const filter = h("select", { "aria-label": "Jobs to show" }, options);
  const search = h("input", {
    type: "search",
    maxLength: 100,
    placeholder: "Name, owner, method or id",
    "aria-label": "Search jobs",
  });
  const late = h("p", { class: "late", role: "status", hidden: true });
  const timelineTitle = h("h2", { id: "timeline-title" }, "Timeline");
  const timeline = h(
    "section",
    { class: "part", id: "timeline", "aria-labelledby": "timeline-title" },
    timelineTitle,
    parts.timeline.element,
  );
  timeline.hidden = true;
  const element = h(
    "div",
    { class: "board" },
    h("div", { class: "board-head" }, h("h1", {}, "Operations"), late),
    parts.figures.element,
    section("machine", "This machine", parts.machine.element),
    section("workers", "Workers", parts.workers.element),
    section("machines", "Machines", parts.nodes.element),
    section("jobs", "Jobs", h("div", { class: "jobs-filter" }, search, filter), parts.jobs.element),
    timeline,
    section("failures", "Failures", parts.failures.element),
    section("live", "Live sessions", parts.live.element),
  );
  let timer = 0;
  let pause = EVERY_MS;
  let turn = 0;

  function show(overview: Overview): void {
    parts.figures.update(overview);
    parts.machine.update(overview.machine);
    parts.workers.update(overview.workers);
    parts.nodes.update(overview.nodes);
    parts.jobs.update(overview.jobs);
    parts.failures.update(overview.failures);
    parts.live.update(overview.live);
    late.hidden = true;
    pause = EVERY_MS;
  }

  async function refresh(): Promise<void> {
    const mine = ++turn;
    clearTimeout(timer);
    try {
      const overview = await ops.readOverview(chosen, controller.signal);
      if (mine === turn) show(overview);
      if (mine === turn && chosen.job) await showTimeline(chosen.job, overview.snapshot.at);
    } catch (error) {
      if (controller.signal.aborted) return;
      const problem = api.asProblem(error);
      if (problem.status === 403) return ondenied(problem);
      complain(problem);
    }
    if (mine === turn && !document.hidden) timer = window.setTimeout(refresh, pause);
  }

  function complain(problem: api.Problem): void {
    late.textContent = `These figures are old: ${problem.message}`;
    late.hidden = false;
    pause = Math.min(LONGEST_MS, 2 * pause);
  }

  async function showTimeline(id: string, now: number): Promise<void> {
    try {
      const [job, bars] = await Promise.all([api.job(id, controller.signal), ops.timeline(id, controller.signal)]);
      if (id !== chosen.job) return;
      timeline.hidden = false;
      timelineTitle.textContent = `Timeline of ${job.request.name || job.request.method}, ${job.state}`;
      parts.timeline.update(job, bars, now);
    } catch (error) {
      if (!(error instanceof api.Problem) || error.status !== 404) throw error;
      chosen.job = null;
      timeline.hidden = true;
    }
  }

  function choose(id: string): void {
    chosen.job = id;
    history.replaceState(null, "", `#job=${encodeURIComponent(id)}`);
    refresh().then(() => timeline.scrollIntoView({ behavior: "smooth", block: "nearest" }));
  }

  const onvisible = () => (document.hidden ? clearTimeout(timer) : refresh());
  document.addEventListener("visibilitychange", onvisible, { signal: controller.signal });
  filter.addEventListener("change", () => {
    chosen.state = filter.value as ops.JobState;
    refresh();
  });
  search.addEventListener("input", () => {
    chosen.search = search.value.trim();
    clearTimeout(timer);
    timer = window.setTimeout(refresh, TYPING_MS);
  });
  show(first);
  refresh();
  return {
    element,
    close() {
      controller.abort();
      clearTimeout(timer);
    },
  };
}

function createParts(calls: BoardCalls) {
  return {
    figures: createFigures(calls),
    machine: createMachine(),
    workers: createWorkers(calls),
    nodes: createNodes(calls),
    jobs: createJobs(calls),
    timeline: createTimeline(),
    failures: createFailures(calls),
    live: createLive(calls),
  };
}

function section(id: string, title: string, ...children: Child[]): HTMLElement {
  const heading = h("h2", { id: `${id}-title` }, title);
  return h("section", { class: "part", id, "aria-labelledby": `${id}-title` }, heading, children);
}

/** The page of one job: its progress while it runs, and the player when it is done. */

import * as api from "../api/api";
import type { Job, Page } from "../api/schemas";
import { hashOfJob } from "../forms/draft";
import type { View } from "../ui/dom";
import { type Child, fill, h } from "../ui/dom";
import { ago, percent } from "../ui/format";
import { iconButton } from "../ui/icons";
import { notify, problemBlock, warningBlock } from "../ui/notices";
import { createFacts } from "./facts";
import { deleteWithUndo } from "./job-list";
import { createJobPreview } from "./job-preview";
import { createProgress, isFinal, type Queue, stateWord } from "./progress";
import { createResult, type Result } from "./result";
import { watchJob } from "./watch-job";

export function createJobPage(id: string): View {
  const element = h("div", { class: "job", "aria-busy": "true" }, h("div", { class: "loading" }, "Loading the job…"));
  const controller = new AbortController();
  const progress = createProgress();
  const preview = createJobPreview(id);
  let result: Result | null = null;
  let drawn = "";

  function missing(problem: api.Problem, again: boolean): void {
    if (!again) controller.abort();
    element.setAttribute("aria-busy", "false");
    const links = [
      h("a", { class: "button", href: "#/jobs" }, "All works"),
      h("a", { class: "button", href: "#/" }, "To the studio"),
    ];
    const shown = problem.status === 404 ? GONE : problem;
    fill(element, h("div", { class: "failure" }, problemBlock(shown, links)));
  }

  function draw(now: Job, queue: Queue | null = null): void {
    document.title = `${isFinal(now) ? stateWord(now) : percent(now.progress)} · ${titleOf(now)} · Impasto`;
    progress.update(now, queue);
    preview.update(now);
    const contents = `${now.state} ${(now.warnings ?? []).map((warning) => warning.message).join()}`;
    if (drawn !== contents) compose(now);
    drawn = contents;
  }

  /** Lay the page out for the job's state. */
  function compose(now: Job): void {
    element.setAttribute("aria-busy", "false");
    result?.close();
    result = now.state === "succeeded" ? createResult(now) : null;
    const side = h(
      "aside",
      { class: "panel job-panel", "aria-label": "Progress" },
      now.error &&
        problemBlock({ title: "The job failed", message: now.error.message, remedy: now.error.remedy ?? "" }),
      warningBlock(
        "Damaged input",
        (now.warnings ?? []).map((warning) => warning.message),
      ),
      result?.downloads,
      now.state === "succeeded" && correction(now, result),
      progress.element,
      h("div", { class: "actions" }, verbs(now)),
      createFacts(now),
    );
    const stage = h("div", { class: "studio-stage" }, heading(now), result?.element ?? preview.element);
    fill(element, h("div", { class: "studio" }, stage, side));
  }

  function verbs(now: Job): Child[] {
    const button = (verb: api.JobVerb, text: string, style = "") =>
      h("button", { type: "button", class: `button ${style}`, onclick: () => act(verb) }, text);
    const change = (style = "") => h("a", { class: `button ${style}`, href: hashOfJob(now) }, "Change settings");
    if (now.state === "paused") return [button("resume", "Resume", "primary"), button("cancel", "Cancel")];
    if (!isFinal(now)) return [button("pause", "Pause"), button("cancel", "Cancel")];
    const leave = () => {
      location.hash = "#/jobs";
    };
    const remove = iconButton("trash", `Delete ${titleOf(now)}`, () => {
      leave();
      deleteWithUndo(id, titleOf(now), () => history.back());
    });
    if (now.state === "succeeded") return [change(), compareLink(now), remove];
    if (retryMayHelp(now)) return [button("retry", "Try again", "primary"), change(), remove];
    return [change("primary"), button("retry", "Try again"), remove];
  }

  async function act(verb: api.JobVerb): Promise<void> {
    const disable = (yes: boolean) => {
      for (const button of element.querySelectorAll<HTMLButtonElement>(".actions button")) button.disabled = yes;
    };
    disable(true);
    await api.act(id, verb).then((now) => draw(now), notify);
    disable(false);
    if (verb === "retry") watch();
  }

  const watch = () => watchJob(id, { onchange: draw, onmissing: missing }, controller.signal);
  watch();
  return {
    element,
    close() {
      controller.abort();
      preview.close();
      result?.close();
    },
  };
}

/** A link to the page that compares the film with those of the project's other variants, once there are two. */
function compareLink(job: Job): HTMLElement | false {
  const { project, variant } = job.request.labels ?? {};
  if (!project || !variant) return false;
  const link = h("a", { class: "button", hidden: true }, "Compare variants");
  const label = `project:${project}`;
  api.get<Page<Job>>(api.url`/v1/jobs?label=${label}&state=succeeded&limit=50`).then(({ items }) => {
    const newest = new Map<string, string>();
    for (const one of items) {
      const name = one.request.labels?.variant;
      if (name && !newest.has(name)) newest.set(name, one.id);
    }
    newest.delete(variant);
    link.href = `#/compare/${[job.id, ...newest.values()].join(",")}`;
    link.hidden = !newest.size;
  }, notify);
  return link;
}

/** Choose a frame of the film that becomes a key of its project; null where there are no painted keys. */
function correction(job: Job, result: Result | null): HTMLElement | null {
  const project = job.request.labels?.project;
  if (!project || job.request.method !== "analogy") return null;
  const first = job.request.frames?.[0] ?? 0;
  const frame = h("input", { type: "number", min: first + 1, value: first + 1, "aria-label": "Frame to correct" });
  const open = () => {
    const wanted = Number(frame.value) - 1;
    location.hash = `#/projects/${project}?film=${job.id}&frame=${Math.max(first, wanted)}`;
  };
  result?.element.addEventListener("frame", (event) => {
    frame.value = String(first + 1 + (event as CustomEvent<number>).detail);
  });
  const button = h("button", { type: "button", class: "button", onclick: open }, "Correct this frame");
  const lossy = job.request.output?.format !== "png" && h("p", { class: "hint" }, LOSSY);
  return h("div", { class: "correct-frame" }, h("label", {}, "Frame ", frame), button, lossy);
}

const GONE = { title: "This job does not exist", message: "It was deleted, or it belongs to another key.", remedy: "" };

const LOSSY = "The frame is taken from the compressed film. A film in PNG frames gives its exact pixels.";

const titleOf = (job: Job): string => job.request.name || job.request.method;

/** Faults of the request come back however often it is tried; crashes and lost machines may not. */
function retryMayHelp({ state, error }: Job): boolean {
  if (state === "cancelled" || !error) return true;
  return !USER_ERRORS.has(error.code);
}

const USER_ERRORS = new Set([
  "bad-input",
  "bad-parameter",
  "bad-media",
  "unreadable-media",
  "damaged-media",
  "no-video-stream",
  "media-too-large",
  "bad-frame",
  "not-found",
]);

function heading(job: Job): HTMLElement {
  const line = `${stateWord(job)} · started ${ago(job.created_at)}`;
  return h(
    "div",
    { class: "film-head" },
    h("div", { class: "film-title" }, h("h1", {}, titleOf(job)), h("p", {}, line)),
  );
}

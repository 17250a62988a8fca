/** The works: cards of all jobs, newest first; the service searches them by words and by state. */

import * as api from "../api/api";
import type { Job, Page } from "../api/schemas";
import type { View } from "../ui/dom";
import { type Child, fill, h } from "../ui/dom";
import { ago, percent } from "../ui/format";
import { icon, iconButton } from "../ui/icons";
import { notify, offerUndo, problemBlock } from "../ui/notices";
import { isFinal, stateWord } from "./progress";

/** Between two requests while a listed job is not final. */
const POLL_MS = 2500;
/** Between two requests otherwise: jobs submitted or deleted elsewhere, or by this page before a reload. */
const IDLE_POLL_MS = 10_000;
/** After the last letter of a search. */
const REST_MS = 250;

export interface JobListOptions {
  /** Jobs a page. */
  limit: number;
  /** Whether there are search, filter, and a button for older jobs. */
  more?: boolean;
  /** Shown while there are no jobs. */
  empty?: Child;
}

export function createJobList({ limit, more = false, empty = "" }: JobListOptions): View {
  const list = h("ul", { class: "works" });
  const rest = h("div", { class: "works-rest" });
  const filter = more ? createFilter(() => search()) : null;
  const nothing = h("p", { class: "works-none", role: "status", hidden: true }, "No work matches.");
  const element = h("div", { "aria-busy": "true" }, filter?.element, nothing, list, rest);
  const cards = new Map<string, Card>();
  let timer = 0;
  let searches = 0;
  let pages = 1;
  let closed = false;

  fill(
    list,
    Array.from({ length: Math.min(limit, 4) }, () => h("li", { class: "work skeleton", "aria-hidden": "true" })),
  );

  async function load(): Promise<void> {
    clearTimeout(timer);
    const mine = searches;
    try {
      const page = await api.jobs(limit, filter?.wanted());
      if (!closed && mine === searches) show(page);
    } catch (error) {
      if (closed) return;
      if (cards.size) {
        timer = window.setTimeout(load, IDLE_POLL_MS);
        return;
      }
      const again = h("button", { type: "button", class: "button", onclick: () => location.reload() }, "Try again");
      fill(element, problemBlock(api.asProblem(error), again));
    }
  }

  /** Begin the list anew with what the filter asks for. */
  function search(): void {
    cards.clear();
    searches += 1;
    pages = 1;
    element.setAttribute("aria-busy", "true");
    clearTimeout(timer);
    timer = window.setTimeout(load, REST_MS);
  }

  function show(page: Page<Job>): void {
    element.setAttribute("aria-busy", "false");
    if (!cards.size) list.replaceChildren();
    dropMissing(page);
    place(page.items, list.firstChild);
    const chosen = Object.keys(filter?.wanted() ?? {}).length > 0;
    nothing.hidden = cards.size > 0 || !chosen;
    if (pages === 1) fill(rest, !cards.size && !chosen && empty, more && page.cursor && moreButton(page.cursor));
    timer = window.setTimeout(load, page.items.some((job) => !isFinal(job)) ? POLL_MS : IDLE_POLL_MS);
  }

  /** Remove cards that belong on this first page and are not there any more: their job was deleted, or has another state. */
  function dropMissing({ items, cursor }: Page<Job>): void {
    const oldest = cursor ? (items.at(-1)?.id ?? "") : "";
    for (const [id, card] of cards) {
      if (id < oldest || items.some((job) => job.id === id)) continue;
      card.element.remove();
      cards.delete(id);
    }
  }

  /** Add cards that are new, refresh those that changed, leave the rest alone. */
  function place(jobs: Job[], before: Node | null = null): void {
    for (const job of jobs) {
      if (job.request.labels?.export) continue; // another format of a film that is listed
      const known = cards.get(job.id);
      if (known) known.update(job);
      else {
        const card = createCard(job, load);
        cards.set(job.id, card);
        list.insertBefore(card.element, before);
      }
    }
  }

  function moreButton(cursor: string): HTMLElement {
    const next = async () => {
      const mine = searches;
      const page = await api.jobs(limit, filter?.wanted(), cursor);
      if (mine !== searches) return; // another search has begun
      pages += 1;
      place(page.items);
      fill(rest, page.cursor && moreButton(page.cursor));
    };
    return h("button", { type: "button", class: "button", onclick: () => next().catch(notify) }, "Show more");
  }

  load();
  return {
    element,
    close() {
      closed = true;
      clearTimeout(timer);
    },
  };
}

const STATES: [string, string][] = [
  ["", "All"],
  ["active", "Running"],
  ["succeeded", "Finished"],
  ["failed", "Failed"],
];

interface Filter {
  element: HTMLElement;
  wanted(): api.JobSearch;
}

function createFilter(changed: () => void): Filter {
  const text = h("input", {
    type: "search",
    placeholder: "Name, method or label",
    "aria-label": "Search works",
    oninput: changed,
  });
  const state = h(
    "select",
    { "aria-label": "Works to show", onchange: changed },
    STATES.map(([value, title]) => h("option", { value }, title)),
  );
  return {
    element: h("div", { class: "works-filter" }, text, state),
    wanted() {
      const search = text.value.trim();
      return {
        ...(search && { search }),
        ...(state.value && { state: state.value as NonNullable<api.JobSearch["state"]> }),
      };
    },
  };
}

/** Labels that a user gave a job; the others say where it came from. */
export const ownLabels = ({ request }: Job): string[] =>
  Object.entries(request.labels ?? {}).flatMap(([name, value]) =>
    ["project", "shot", "variant", "version", "export"].includes(name) ? [] : [value ? `${name}: ${value}` : name],
  );

interface Card {
  element: HTMLElement;
  job: Job;
  update(job: Job): void;
}

function createCard(first: Job, changed: () => void): Card {
  const poster = h("span", { class: "work-poster" });
  const bar = h("span", { class: "work-bar" });
  const state = h("span", { class: "work-state" });
  const title = h("span", { class: "work-title" });
  const actions = h("div", { class: "work-actions" });
  const labels = h(
    "span",
    { class: "work-labels" },
    ownLabels(first).map((label) => h("span", {}, label)),
  );
  const link = h("a", { href: `#/jobs/${first.id}`, class: "work-link" }, poster, bar, title, state, labels);
  const element = h("li", { class: "work" }, link, actions);
  let shown = "";

  function update(now: Job): void {
    card.job = now;
    title.textContent = now.request.name || now.request.method;
    element.dataset.state = now.state;
    bar.style.setProperty("--done", String(now.progress));
    state.textContent = stateLine(now);
    const file = ["poster", "preview"].find((name) => now.results.includes(name));
    const wanted = file ?? "original";
    if (shown !== wanted) {
      shown = wanted;
      showPoster(now, file);
    }
    if (!actions.matches(":focus-within")) fill(actions, buttons(now));
  }

  /** The painted frame, or a frame of the source until there is one. */
  async function showPoster(now: Job, file: string | undefined): Promise<void> {
    if (!file) fill(poster, icon("brush"));
    const video = now.request.inputs.video;
    const path = file ? api.paths.file(now.id, file) : video ? api.paths.frame(video, 0, 480) : "";
    const url = path && (await api.mediaUrl(path).catch(() => ""));
    if (!url) return;
    const picture = h("img", { src: url, alt: "", loading: "lazy", class: file ? "" : "pending" });
    picture.addEventListener("error", () => fill(poster, icon("brush")));
    fill(poster, picture);
  }

  function buttons(now: Job): Child[] {
    const retry = () => api.act(now.id, "retry").then(changed, notify);
    const name = title.textContent ?? "";
    const again = ["failed", "cancelled"].includes(now.state) && iconButton("retry", `Try ${name} again`, retry);
    const remove =
      isFinal(now) &&
      iconButton("trash", `Delete ${name}`, () => {
        element.classList.add("deleted");
        deleteWithUndo(now.id, name, () => element.classList.remove("deleted"));
      });
    return [again, remove];
  }

  const card: Card = { element, job: first, update };
  update(first);
  return card;
}

function stateLine(job: Job): string {
  if (job.state === "running") return `Painting, ${percent(job.progress)}`;
  return job.state === "succeeded" ? ago(job.created_at) : `${stateWord(job)} · ${ago(job.created_at)}`;
}

/** Delete a job after a few seconds in which the user can undo it. */
export function deleteWithUndo(id: string, name: string, undo: () => void): void {
  offerUndo(`Deleted “${name}”.`, undo, () => api.forget(id).catch(notify));
}

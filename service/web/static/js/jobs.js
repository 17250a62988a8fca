/** The works: cards of all jobs, newest first. */

import * as api from "./api.js";
import { fill, h, icon, iconButton } from "./dom.js";
import { ago, percent } from "./format.js";
import { notify, problemBlock } from "./notices.js";
import { isFinal, stateWord } from "./progress.js";

const POLL_MS = 2500;

/** @param {{limit: number, more?: boolean, empty?: Node}} options @returns {{element, close()}} */
export function createJobs({ limit, more = false, empty = "" }) {
  const list = h("ul", { class: "works" });
  const rest = h("div", { class: "works-rest" });
  const element = h("div", { "aria-busy": "true" }, list, rest);
  const cards = new Map();
  let timer = 0;
  let closed = false;

  fill(list, Array.from({ length: Math.min(limit, 4) }, () => h("li", { class: "work skeleton", "aria-hidden": "true" })));

  async function load() {
    try {
      const page = await api.jobs(limit);
      if (!closed) show(page);
    } catch (problem) {
      if (!closed) fill(element, problemBlock(problem, h("button", { type: "button", class: "button", onclick: () => location.reload() }, "Try again")));
    }
  }

  function show(page) {
    element.setAttribute("aria-busy", "false");
    if (!cards.size) list.replaceChildren();
    place(page.items, list.firstChild);
    fill(rest, !cards.size && empty, more && page.cursor && moreButton(page.cursor));
    if (page.items.some((job) => !isFinal(job))) timer = setTimeout(load, POLL_MS);
  }

  /** Add cards that are new, refresh those that changed, leave the rest alone. */
  function place(jobs, before = null) {
    for (const job of jobs) {
      const known = cards.get(job.id);
      if (known) known.update(job);
      else {
        const card = createCard(job, { gone: () => cards.delete(job.id), changed: load });
        cards.set(job.id, card);
        list.insertBefore(card.element, before);
      }
    }
  }

  function moreButton(cursor) {
    const next = async () => {
      const page = await api.jobs(limit, cursor);
      place(page.items);
      fill(rest, page.cursor && moreButton(page.cursor));
    };
    return h("button", { type: "button", class: "button", onclick: () => next().catch(notify) }, "Show more");
  }

  load();
  return { element, close: () => ((closed = true), clearTimeout(timer)) };
}

function createCard(job, { gone, changed }) {
  const poster = h("span", { class: "work-poster" });
  const bar = h("span", { class: "work-bar" });
  const state = h("span", { class: "work-state" });
  const title = h("span", { class: "work-title" });
  const actions = h("div", { class: "work-actions" });
  const element = h("li", { class: "work" }, h("a", { href: `#/jobs/${job.id}`, class: "work-link" }, poster, bar, title, state), actions);
  let shown = "";

  function update(now) {
    title.textContent = now.name || now.request.name || now.request.method;
    element.dataset.state = now.state;
    bar.style.setProperty("--done", String(now.progress));
    state.textContent = now.state === "running" ? `Painting, ${percent(now.progress)}` : `${now.state === "succeeded" ? "" : `${stateWord(now)} · `}${ago(now.created_at)}`;
    const file = ["poster", "preview"].find((name) => now.results.includes(name));
    if (file && shown !== file) showPoster(now.id, (shown = file));
    else if (!file) fill(poster, icon("brush"));
    if (!actions.matches(":focus-within")) fill(actions, buttons(now));
  }

  async function showPoster(id, file) {
    const url = await api.mediaUrl(api.paths.file(id, file)).catch(() => null);
    if (url) fill(poster, h("img", { src: url, alt: "", loading: "lazy" }));
  }

  function buttons(now) {
    const retry = () => api.act(now.id, "retry").then(changed, notify);
    const name = title.textContent;
    return [
      ["failed", "cancelled"].includes(now.state) && iconButton("retry", `Try ${name} again`, retry),
      isFinal(now) && deletion(now.id, name, () => (element.remove(), gone())),
    ];
  }

  update(job);
  return { element, update };
}

/** A button that asks once more before it deletes. `gone()` is called when the service has forgotten the job. */
export function deletion(id, name, gone) {
  const ask = iconButton("trash", `Delete ${name}`, () => toggle(true));
  const keep = h("button", { type: "button", class: "button small", onclick: () => toggle(false) }, "Keep");
  const sure = h("button", { type: "button", class: "button small danger", onclick: () => api.forget(id).then(gone, notify) }, "Delete");
  const question = h("span", { class: "sure", hidden: true, role: "group", "aria-label": `Delete ${name}?` }, sure, keep);
  const toggle = (asking) => {
    question.hidden = !asking;
    ask.hidden = asking;
    (asking ? keep : ask).focus();
  };
  return h("span", { class: "deletion" }, ask, question);
}

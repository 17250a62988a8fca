/** Where the page starts: which view belongs to the address, and what passes from one to the next. */

import * as api from "./api.js";
import { fill, h } from "./dom.js";
import { draftHash, readDraft } from "./draft.js";
import { createJobView } from "./job-view.js";
import { createJobs } from "./jobs.js";
import { askKey } from "./key.js";
import { problemBlock } from "./notices.js";
import { createStudio } from "./studio.js";
import { createWelcome } from "./welcome.js";

const main = document.getElementById("main");
let view = { close() {} };
let turn = 0;

api.onKeyNeeded(askKey);

/** "#/jobs/job_1?x=y" -> ["jobs", "job_1"], "x=y". */
function address() {
  const [path, query = ""] = location.hash.replace(/^#\/?/, "").split(/\?(.*)/s);
  return [path.split("/").filter(Boolean), query];
}

async function route() {
  const mine = ++turn;
  const [[place = "studio", id], query] = address();
  document.title = "Impasto";
  document.querySelectorAll("[data-route]").forEach((link) => mark(link, link.dataset.route === place));
  const next = await make(place, id, query).catch(failure);
  if (mine !== turn) return next.close();
  show(next);
}

function mark(link, here) {
  if (here) link.setAttribute("aria-current", "page");
  else link.removeAttribute("aria-current");
}

function make(place, id, query) {
  if (place === "jobs" && id) return Promise.resolve(createJobView(decodeURIComponent(id)));
  return place === "jobs" ? Promise.resolve(works()) : studio(readDraft(query));
}

function show(next) {
  view.close();
  view = next;
  fill(main, next.element);
  window.scrollTo(0, 0);
}

async function studio(draft) {
  if (!draft.video) return welcome();
  const [methods, asset] = await Promise.all([api.methods(), api.asset(draft.video)]);
  return createStudio({ methods, asset, draft, ondiscard: discard });
}

function discard() {
  location.hash = "#/";
}

function welcome() {
  const arrived = async (asset, file) => {
    const draft = { ...readDraft(""), video: asset.id };
    history.pushState(null, "", draftHash(draft));
    const localUrl = asset.media_type.startsWith("video/") ? URL.createObjectURL(file) : undefined;
    const made = api.methods().then((methods) => createStudio({ methods, asset, localUrl, draft, ondiscard: discard }));
    turn++;
    show(await made.catch(failure));
  };
  const start = createWelcome({ onasset: arrived });
  const recent = createJobs({ limit: 5, empty: h("p", {}, "What you paint hangs here.") });
  const shelf = h("section", { class: "recent" }, h("div", { class: "recent-head" }, h("h2", {}, "Recent works"), h("a", { href: "#/jobs" }, "All works")), recent.element);
  return { element: h("div", { class: "home" }, start.element, shelf), close: () => (start.close(), recent.close()) };
}

function works() {
  const empty = h("div", { class: "empty" }, h("img", { src: "/static/img/strokes.svg", alt: "" }), h("h2", {}, "Nothing on the walls yet"), h("p", {}, "What you paint hangs here."), h("a", { class: "button primary", href: "#/" }, "To the studio"));
  const list = createJobs({ limit: 24, more: true, empty });
  return { element: h("div", { class: "works-page" }, h("h1", {}, "Works"), list.element), close: list.close };
}

function failure(problem) {
  if (!(problem instanceof api.Problem)) console.error(problem);
  const again = h("button", { type: "button", class: "button primary", onclick: route }, "Try again");
  const home = h("a", { class: "button", href: "#/" }, "To the studio");
  return { element: h("div", { class: "failure" }, problemBlock(problem, again, home)), close() {} };
}

document.getElementById("skip").addEventListener("click", () => main.focus());
for (const kind of ["dragover", "drop"]) window.addEventListener(kind, (event) => event.preventDefault());
window.addEventListener("hashchange", route);
route();

/** Start of the studio's page: which view belongs to the address, and what passes from one to the next. */

import { under } from "./shared/base";
import "./css/base.css";
import "./css/controls.css";
import "./css/stage.css";
import "./css/studio.css";
import "./css/jobs.css";
import "./css/clusters.css";
import "./css/designer.css";
import { createProject, readProject } from "./designer/api";
import { addAsset, changeLayer, newDocument, type ProjectDocument } from "./designer/document";
import * as api from "./shared/api";
import { fill, h } from "./shared/dom";
import { type Draft, draftHash, readDraft } from "./shared/draft";
import { problemBlock } from "./shared/notices";
import { preparePage } from "./shared/page";
import type { Asset, View } from "./shared/types";
import { createProjectList } from "./studio/project-list";
import { createQuickPage } from "./studio/quick-page";
import { createSharedPage } from "./studio/shared-page";
import { createWelcome } from "./studio/welcome";
import { createComparePage } from "./works/compare-page";
import { createJobList } from "./works/job-list";
import { createJobPage } from "./works/job-page";

const main = preparePage();
let view: View | null = null;
let turn = 0;

/** "#/jobs/job_1?x=y" -> ["jobs", "job_1"], "x=y". */
function address(): [string[], string] {
  const [path = "", query = ""] = location.hash.replace(/^#\/?/, "").split(/\?(.*)/s);
  return [path.split("/").filter(Boolean), query];
}

async function route(): Promise<void> {
  const mine = ++turn;
  const [[place = "studio", id], query] = address();
  document.title = "Impasto";
  for (const link of document.querySelectorAll<HTMLElement>("[data-route]")) mark(link, link.dataset.route === place);
  const next = await make(place, id, query).catch(failure);
  if (mine === turn) show(next);
  else next.close();
}

function mark(link: HTMLElement, here: boolean): void {
  if (here) link.setAttribute("aria-current", "page");
  else link.removeAttribute("aria-current");
}

async function make(place: string, id: string | undefined, query: string): Promise<View> {
  if (place === "jobs") return id ? createJobPage(decodeURIComponent(id)) : works();
  if (place === "compare" && id) return createComparePage(decodeURIComponent(id).split(","));
  if (place === "shared" && id) return createSharedPage(decodeURIComponent(id));
  if (place === "projects" && id) return designer(decodeURIComponent(id), query);
  const draft = readDraft(query);
  if (!draft.video) return welcome();
  return quickPage(await api.asset(draft.video), draft);
}

function show(next: View): void {
  view?.close();
  view = next;
  fill(main, next.element);
  window.scrollTo(0, 0);
}

/** The studio, whose code is loaded when it is first opened. */
async function designer(id: string, query = ""): Promise<View> {
  const { createDesigner } = await import("./designer/designer");
  const [project, methods] = await Promise.all([readProject(id), api.methods()]);
  const shot = project.document.shots[0];
  if (!shot) throw new api.Problem({ detail: "This project has no shot.", remedy: "Make a new one from a video." });
  const asset = await api.asset(project.document.assets[shot.video]?.id ?? "");
  const wanted = new URLSearchParams(query);
  const film = wanted.get("film");
  const take = film ? { film, frame: Number(wanted.get("frame")) } : undefined;
  if (take) history.replaceState(null, "", `#/projects/${encodeURIComponent(id)}`); // once, not at every reload
  return createDesigner({ project, asset, methods, reload: () => route(), take });
}

/** Make a project of the quick page's settings, and open it. */
async function openInStudio(asset: Asset, draft: Draft): Promise<void> {
  const name = asset.filename.replace(/\.[^.]+$/, "");
  const project = await createProject(documentOf(name, asset, draft));
  location.hash = `#/projects/${project.id}`;
}

/** The first project: a clip of Impasto's own, and a list of what to do. */
async function openLesson(): Promise<void> {
  const clip: Asset = await (await api.request("/v1/scenes/harbour/assets", { method: "POST" })).json();
  const document = { ...newDocument("My first keys", clip.id, "analogy"), ui: { lesson: "keys" } };
  location.hash = `#/projects/${(await createProject(document)).id}`;
}

function documentOf(name: string, asset: Asset, draft: Draft): ProjectDocument {
  let document = newDocument(name, asset.id, draft.method);
  const inputs: Record<string, string> = {};
  for (const [input, id] of Object.entries(draft.inputs)) {
    const [next, assetName] = addAsset(document, input, { id });
    document = next;
    inputs[input] = assetName;
  }
  return changeLayer(document, { shot: "s1", layer: "l1" }, (layer) => ({ ...layer, params: draft.params, inputs }));
}

async function quickPage(asset: Asset, draft: Draft, localUrl?: string): Promise<View> {
  const ondiscard = () => {
    location.hash = "#/";
  };
  const onopen = (now: Draft) => openInStudio(asset, now);
  return createQuickPage({ methods: await api.methods(), asset, localUrl, draft, ondiscard, onopen });
}

function welcome(): View {
  const arrived = async (asset: Asset, file: File) => {
    const draft = { ...readDraft(""), video: asset.id };
    history.pushState(null, "", draftHash(draft));
    turn++;
    const localUrl = asset.media_type.startsWith("video/") ? URL.createObjectURL(file) : undefined;
    show(await quickPage(asset, draft, localUrl).catch(failure));
  };
  const start = createWelcome(arrived, openLesson);
  const latest = createJobList({ limit: 5, empty: h("p", {}, "Your finished films appear here.") });
  const head = h("div", { class: "latest-head" }, h("h2", {}, "Recent works"), h("a", { href: "#/jobs" }, "All works"));
  const close = () => {
    start.close();
    latest.close();
  };
  const works = h("section", { class: "latest" }, head, latest.element);
  return { element: h("div", { class: "home" }, start.element, createProjectList(), works), close };
}

function works(): View {
  const empty = h(
    "div",
    { class: "empty" },
    h("img", { src: under("/static/img/strokes.svg"), alt: "" }),
    h("h2", {}, "No works yet"),
    h("p", {}, "Drop a video in the studio, choose a method and paint it: the film appears here."),
    h("a", { class: "button primary", href: "#/" }, "To the studio"),
  );
  const list = createJobList({ limit: 24, more: true, empty });
  return { element: h("div", { class: "works-page" }, h("h1", {}, "Works"), list.element), close: list.close };
}

function failure(error: unknown): View {
  const again = h("button", { type: "button", class: "button primary", onclick: () => route() }, "Try again");
  const home = h("a", { class: "button", href: "#/" }, "To the studio");
  return { element: h("div", { class: "failure" }, problemBlock(api.asProblem(error), again, home)), close() {} };
}

window.addEventListener("hashchange", () => route());
route();

/** Start of the studio's page: which view belongs to the address, and what passes from one to the next. */

import { under } from "./api/base";
import "./css/base.css";
import "./css/controls.css";
import "./css/stage.css";
import "./css/home.css";
import "./css/jobs.css";
import "./css/clusters.css";
import "./css/studio.css";
import "./css/film.css";
import "./css/drawing.css";
import type { VNode } from "preact";
import * as api from "./api/api";
import type { Asset, Schemas } from "./api/schemas";
import { type Draft, draftHash, readDraft } from "./forms/draft";
import { AccountPage, readAccount } from "./home/account-page";
import { ProjectList } from "./home/project-list";
import { QuickPage } from "./home/quick-page";
import { readShared, SharedPage } from "./home/shared-page";
import { Welcome } from "./home/welcome";
import { ComparePage } from "./jobs/compare-page";
import { JobList } from "./jobs/job-list";
import { JobPage } from "./jobs/job-page";
import { createProject } from "./studio/document/api";
import { addAsset, changeLayer, newDocument, type ProjectDocument } from "./studio/document/document";
import { addClips, renameShot } from "./studio/document/shots";
import { byId } from "./ui/dom";
import { ProblemBlock } from "./ui/notices";
import { preparePage } from "./ui/page";

const fill = preparePage();
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
  const next = await make(place, id, query).catch((error) => <Failure error={error} />);
  if (mine === turn) show(next);
  if (place !== "shared") offerAccount();
}

/** Show the way to the account, in a group with its name; who works without a key, or looks at a link, has none. */
async function offerAccount(): Promise<void> {
  const link = byId("account");
  if (!link.hidden) return;
  const me = await api.get<Schemas["MeOut"]>("/v1/me").catch(() => null);
  link.hidden = !me?.user;
  link.textContent = me?.groups.find(({ group }) => group === me.owner)?.name ?? "Account";
}

function mark(link: HTMLElement, here: boolean): void {
  if (here) link.setAttribute("aria-current", "page");
  else link.removeAttribute("aria-current");
}

/** Every visit of an address is a new page, also of the same one. */
function show(page: VNode): void {
  fill(page);
  window.scrollTo(0, 0);
}

async function make(place: string, id: string | undefined, query: string): Promise<VNode> {
  if (place === "jobs") return id ? <JobPage id={decodeURIComponent(id)} /> : <Works />;
  if (place === "compare" && id) return <ComparePage ids={decodeURIComponent(id).split(",")} />;
  if (place === "shared" && id) {
    const shared = await readShared(decodeURIComponent(id));
    document.title = `${shared.project.name} · Impasto`;
    return <SharedPage {...shared} />;
  }
  if (place === "account") return <AccountPage {...(await readAccount())} />;
  if (place === "projects" && id) return studio(decodeURIComponent(id), query);
  const draft = readDraft(query);
  if (!draft.video) return <Home />;
  return quickPage(await api.asset(draft.video), draft);
}

/** The studio, whose code is loaded when it is first opened. */
async function studio(id: string, query = ""): Promise<VNode> {
  const [{ StudioPage, openSession }, { openProject }] = await Promise.all([
    import("./studio/shell/studio-page"),
    import("./studio/shell/saving"),
  ]);
  const [project, methods] = await Promise.all([openProject(id), api.methods()]);
  if (!project.document.shots.length)
    throw new api.Problem({ detail: "This project has no shot.", remedy: "Make a new one from a video." });
  const wanted = new URLSearchParams(query);
  const film = wanted.get("film");
  const take = film ? { film, frame: Number(wanted.get("frame")) } : undefined;
  const shot = film ? (await api.job(film)).request.labels?.shot : undefined;
  if (take) history.replaceState(null, "", `#/projects/${encodeURIComponent(id)}`); // once, not at every reload
  const opened = await openSession(project, methods, shot);
  return <StudioPage project={project} {...opened} reload={() => route()} take={take} />;
}

/** Make a project of the quick page's settings, and open it. */
async function openInStudio(asset: Asset, draft: Draft): Promise<void> {
  const name = asset.filename.replace(/\.[^.]+$/, "");
  const project = await createProject(documentOf(name, asset, draft));
  location.hash = `#/projects/${project.id}`;
}

/** Make a project of clips, each a shot, and open it. */
async function openFilm(clips: Asset[]): Promise<void> {
  const [first, ...others] = clips.map(({ id, filename }) => ({ id, title: filename }));
  if (!first) return;
  const method = readDraft("").method || ((await api.methods())[0]?.name ?? "");
  const document = addClips(newDocument("My film", first.id, method), others, method);
  const named = renameShot(document, "s1", first.title.replace(/\.[^.]+$/, ""));
  location.hash = `#/projects/${(await createProject(named)).id}`;
}

/** The first project: a clip of Impasto's own, and a list of what to do. */
async function openLesson(): Promise<void> {
  const clip: Asset = await (await api.request("/v1/scenes/harbour/assets", { method: "POST" })).json();
  const method = (await api.methods()).find(({ studio }) => studio.sections.some(({ editor }) => editor === "keys"));
  if (!method) throw new api.Problem({ detail: "No method of this service uses painted keys.", code: "no-method" });
  const document = { ...newDocument("My first keys", clip.id, method.name), ui: { lesson: "keys" } };
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

async function quickPage(asset: Asset, draft: Draft, localUrl?: string): Promise<VNode> {
  const ondiscard = () => {
    location.hash = "#/";
  };
  const methods = await api.methods();
  const onopen = (now: Draft) => openInStudio(asset, now);
  return <QuickPage {...{ methods, asset, localUrl, draft, ondiscard, onopen }} />;
}

function Home() {
  const arrived = async (asset: Asset, file: File) => {
    const draft = { ...readDraft(""), video: asset.id };
    history.pushState(null, "", draftHash(draft));
    turn++;
    const localUrl = asset.media_type.startsWith("video/") ? URL.createObjectURL(file) : undefined;
    show(await quickPage(asset, draft, localUrl).catch((error) => <Failure error={error} />));
  };
  return (
    <div class="home">
      <Welcome onasset={arrived} onfilm={openFilm} onlearn={openLesson} />
      <ProjectList />
      <section class="latest">
        <div class="latest-head">
          <h2>Recent works</h2>
          <a href="#/jobs">All works</a>
        </div>
        <JobList limit={5} empty={<p>Your finished films appear here.</p>} />
      </section>
    </div>
  );
}

const Works = () => (
  <div class="works-page">
    <h1>Works</h1>
    <JobList limit={24} more empty={<NoWorks />} />
  </div>
);

const NoWorks = () => (
  <div class="empty">
    <img src={under("/static/img/strokes.svg")} alt="" />
    <h2>No works yet</h2>
    <p>Drop a video in the studio, choose a method and paint it: the film appears here.</p>
    <a class="button primary" href="#/">
      To the studio
    </a>
  </div>
);

function Failure({ error }: { error: unknown }) {
  return (
    <div class="failure">
      <ProblemBlock error={api.asProblem(error)}>
        <button type="button" class="button primary" onClick={() => route()}>
          Try again
        </button>
        <a class="button" href="#/">
          To the studio
        </a>
      </ProblemBlock>
    </div>
  );
}

window.addEventListener("hashchange", () => route());
route();

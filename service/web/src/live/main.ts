/** Start of the live page. */

import { under } from "../shared/base";
import "../css/base.css";
import "../css/controls.css";
import "../css/stage.css";
import "../css/studio.css";
import "../css/jobs.css";
import "../css/live.css";
import * as api from "../shared/api";
import { fill, h } from "../shared/dom";
import { readDraft } from "../shared/draft";
import { problemBlock } from "../shared/notices";
import { preparePage } from "../shared/page";
import { readLiveInfo } from "./connection";
import { createLivePage } from "./page";

const main = preparePage();

async function begin(): Promise<void> {
  const draft = readDraft(location.hash.split("?")[1] ?? "");
  const [live, methods] = await Promise.all([readLiveInfo(), api.methods()]);
  const able = methods.filter(({ name }) => live.methods.includes(name));
  const filters = methods.filter(({ name }) => live.filters.includes(name));
  if (!able.length || !live.capacity) throw closed();
  const known = able.some(({ name }) => name === draft.method);
  fill(main, createLivePage({ methods: able, filters }, known ? draft : readDraft("")));
}

const closed = (): api.Problem =>
  new api.Problem({
    title: "No live sessions here",
    detail: "This service has no live sessions.",
    remedy: "Its operator can allow them with IMPASTO_LIVE_SESSIONS; films are painted in the studio.",
  });

function failure(error: unknown): void {
  const again = h("button", { type: "button", class: "button primary", onclick: start }, "Try again");
  const home = h("a", { class: "button", href: under("/") }, "To the studio");
  fill(main, h("div", { class: "failure" }, problemBlock(api.asProblem(error), again, home)));
}

const start = (): Promise<void> => begin().catch(failure);

start();

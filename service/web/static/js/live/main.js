/** Where the live page starts. */

import * as api from "../api.js";
import { fill, h } from "../dom.js";
import { readDraft } from "../draft.js";
import { askKey } from "../key.js";
import { problemBlock } from "../notices.js";
import { lookAround } from "./connection.js";
import { createLivePage } from "./page.js";

const main = document.getElementById("main");

api.onKeyNeeded(askKey);

async function begin() {
  const draft = readDraft(location.hash.split("?")[1] ?? "");
  const [live, methods] = await Promise.all([lookAround(), api.methods()]);
  const able = methods.filter((method) => live.methods.includes(method.name));
  const method = able.find(({ name }) => name === draft.method) ?? able[0];
  if (!method || !live.capacity) throw closed();
  fill(main, createLivePage({ method, draft: method.name === draft.method ? draft : {} }).element);
}

const closed = () =>
  new api.Problem({ title: "No live sessions here", detail: "This service does not paint live.", remedy: "Its operator can allow it with IMPASTO_LIVE_SESSIONS; films are painted in the studio." });

function failure(problem) {
  if (!(problem instanceof api.Problem)) console.error(problem);
  const again = h("button", { type: "button", class: "button primary", onclick: start }, "Try again");
  fill(main, h("div", { class: "failure" }, problemBlock(problem, again, h("a", { class: "button", href: "/" }, "To the studio"))));
}

const start = () => begin().catch(failure);

document.getElementById("skip").addEventListener("click", () => main.focus());
for (const kind of ["dragover", "drop"]) window.addEventListener(kind, (event) => event.preventDefault());
start();

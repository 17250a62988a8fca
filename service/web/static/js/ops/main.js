/** Where the operations page starts: with a key that may, or by asking for one. */

import * as api from "../api.js";
import { fill, h } from "../dom.js";
import { askKey } from "../key.js";
import { problemBlock } from "../notices.js";
import { look } from "./api.js";
import { createBoard } from "./board.js";

const main = document.getElementById("main");
let board = null;

api.onKeyNeeded(askKey);

async function begin() {
  fill(main, h("div", { class: "loading" }, "Looking around…"));
  board = createBoard(await look(""), failure);
  fill(main, board.element);
}

function failure(problem) {
  board?.close();
  board = null;
  if (!(problem instanceof api.Problem)) console.error(problem);
  const again = h("button", { type: "button", class: "button", onclick: start }, "Try again");
  const other = h("button", { type: "button", class: "button primary", onclick: useAnother }, "Use another key");
  fill(main, h("div", { class: "failure" }, problemBlock(problem, problem.status === 403 && other, again)));
}

async function useAnother() {
  await api.renewKey(sessionStorage.getItem("impasto.key"));
  start();
}

const start = () => begin().catch(failure);

document.getElementById("skip").addEventListener("click", () => main.focus());
start();

/** Start of the operations page: with an admin key, or by asking for one. */

import "../css/base.css";
import "../css/controls.css";
import "../css/ops.css";
import * as api from "../api/api";
import type { View } from "../ui/dom";
import { fill, h } from "../ui/dom";
import { problemBlock } from "../ui/notices";
import { preparePage } from "../ui/page";
import { readOverview } from "./api";
import { createBoard } from "./board";

const main = preparePage();
let board: View | null = null;

async function begin(): Promise<void> {
  fill(main, h("div", { class: "loading" }, "Loading…"));
  board = createBoard(await readOverview({ state: "", search: "" }), failure);
  fill(main, board.element);
}

function failure(error: unknown): void {
  board?.close();
  board = null;
  const problem = api.asProblem(error);
  const again = h("button", { type: "button", class: "button", onclick: start }, "Try again");
  const other = h("button", { type: "button", class: "button primary", onclick: useAnother }, "Use another key");
  fill(main, h("div", { class: "failure" }, problemBlock(problem, problem.status === 403 && other, again)));
}

async function useAnother(): Promise<void> {
  await api.renewKey(sessionStorage.getItem("impasto.key"));
  start();
}

const start = (): Promise<void> => begin().catch(failure);

start();

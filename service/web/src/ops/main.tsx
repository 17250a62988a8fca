/** Start of the operations page: with an admin key, or by asking for one. */

import "../css/base.css";
import "../css/controls.css";
import "../css/ops.css";
import * as api from "../api/api";
import { ProblemBlock } from "../ui/notices";
import { preparePage } from "../ui/page";
import { readOverview } from "./api";
import { Board } from "./board";

const show = preparePage();

async function start(): Promise<void> {
  show(<div class="loading">Loading…</div>);
  try {
    show(<Board first={await readOverview({ state: "", search: "" })} ondenied={fail} />);
  } catch (error) {
    fail(error);
  }
}

function fail(error: unknown): void {
  const problem = api.asProblem(error);
  show(
    <div class="failure">
      <ProblemBlock error={problem}>
        {problem.status === 403 && (
          <button type="button" class="button primary" onClick={useAnother}>
            Use another key
          </button>
        )}
        <button type="button" class="button" onClick={start}>
          Try again
        </button>
      </ProblemBlock>
    </div>,
  );
}

async function useAnother(): Promise<void> {
  await api.renewKey(sessionStorage.getItem("impasto.key"));
  start();
}

start();

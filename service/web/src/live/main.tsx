/** Start of the live page. */

import { under } from "../api/base";
import "../css/base.css";
import "../css/controls.css";
import "../css/stage.css";
import "../css/home.css";
import "../css/jobs.css";
import "../css/live.css";
import * as api from "../api/api";
import { readDraft } from "../forms/draft";
import { ProblemBlock } from "../ui/notices";
import { preparePage } from "../ui/page";
import { readLiveInfo } from "./connection";
import { LivePage } from "./page";
import { Live } from "./session";

const show = preparePage();

async function start(): Promise<void> {
  try {
    const draft = readDraft(location.hash.split("?")[1] ?? "");
    const [info, methods] = await Promise.all([readLiveInfo(), api.methods()]);
    const able = methods.filter(({ name }) => info.methods.includes(name));
    const filters = methods.filter(({ name }) => info.filters.includes(name));
    if (!able.length || !info.capacity) throw closed();
    const known = able.some(({ name }) => name === draft.method);
    show(<LivePage live={new Live({ methods: able, filters }, known ? draft : readDraft(""))} />);
  } catch (error) {
    fail(error);
  }
}

const closed = (): api.Problem =>
  new api.Problem({
    title: "No live sessions here",
    detail: "This service has no live sessions.",
    remedy: "Its operator can allow them with IMPASTO_LIVE_SESSIONS; films are painted in the studio.",
  });

const fail = (error: unknown): void =>
  show(
    <div class="failure">
      <ProblemBlock error={api.asProblem(error)}>
        <button type="button" class="button primary" onClick={start}>
          Try again
        </button>
        <a class="button" href={under("/")}>
          To the studio
        </a>
      </ProblemBlock>
    </div>,
  );

start();

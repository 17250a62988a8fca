/** The board: every part of the page, refreshed every two seconds while the tab is visible. */

import type { ComponentChildren } from "preact";
import { useEffect, useRef, useState } from "preact/hooks";
import * as api from "../api/api";
import type { Job } from "../api/schemas";
import * as ops from "./api";
import { Failures } from "./failures";
import { Figures } from "./figures";
import { Nodes, Workers } from "./fleet";
import { Jobs, LiveSessions } from "./jobs";
import { MachineFigures } from "./machine";
import { Audit, Costs, Owners, Retention } from "./owners";
import { Timeline } from "./timeline";
import type { Bar, Overview } from "./types";

const EVERY_MS = 2000;
const LONGEST_MS = 15_000;
/** Pause in typing after which a search begins. */
const TYPING_MS = 250;
const STATES: ops.JobState[] = ["", "queued", "running", "paused", "failed", "cancelled", "succeeded"];

interface Shown {
  overview: Overview;
  timeline: { job: Job; bars: Bar[] } | null;
  /** Why the figures are old; empty: they are not. */
  late: string;
}

interface Chosen extends ops.JobFilter {
  /** The job whose timeline is shown. */
  job: string | null;
}

/** `first`: the overview read at the start; `ondenied` is called when the key is no admin's (any more). */
export function Board({ first, ondenied }: { first: Overview; ondenied(problem: api.Problem): void }) {
  const [chosen, setChosen] = useState<Chosen>({
    job: new URLSearchParams(location.hash.slice(1)).get("job"),
    state: "",
    search: "",
  });
  const { shown, again } = useOverview(first, chosen, ondenied);
  const { overview, timeline, late } = shown;
  const onjob = (job: string) => {
    history.replaceState(null, "", `#job=${encodeURIComponent(job)}`);
    setChosen({ ...chosen, job });
  };
  return (
    <div class="board">
      <div class="board-head">
        <h1>Operations</h1>
        <p class="late" role="status" hidden={!late}>
          {late && `These figures are old: ${late}`}
        </p>
      </div>
      <Figures overview={overview} again={again} />
      <Part id="machine" title="This machine">
        <MachineFigures machine={overview.machine} />
      </Part>
      <Part id="workers" title="Workers">
        <Workers workers={overview.workers} again={again} onjob={onjob} />
      </Part>
      <Part id="machines" title="Machines">
        <Nodes nodes={overview.nodes} again={again} />
      </Part>
      <Part id="jobs" title="Jobs">
        <div class="jobs-filter">
          <input
            type="search"
            maxLength={100}
            placeholder="Name, owner, method or id"
            aria-label="Search jobs"
            onInput={(event) => setChosen({ ...chosen, search: event.currentTarget.value.trim() })}
          />
          <select
            aria-label="Jobs to show"
            value={chosen.state}
            onChange={(event) => setChosen({ ...chosen, state: event.currentTarget.value as ops.JobState })}
          >
            {STATES.map((state) => (
              <option key={state} value={state}>
                {state || "all states"}
              </option>
            ))}
          </select>
        </div>
        <Jobs jobs={overview.jobs} again={again} onjob={onjob} />
      </Part>
      {timeline && (
        <Part
          id="timeline"
          title={`Timeline of ${timeline.job.request.name || timeline.job.request.method}, ${timeline.job.state}`}
        >
          <Timeline key={timeline.job.id} {...timeline} now={overview.snapshot.at} />
        </Part>
      )}
      <Part id="failures" title="Failures">
        <Failures failures={overview.failures} again={again} onjob={onjob} />
      </Part>
      <Part id="live" title="Live sessions">
        <LiveSessions sessions={overview.live} again={again} />
      </Part>
      <Owners />
      <Audit />
      <Costs />
      <Retention />
    </div>
  );
}

function Part({ id, title, children }: { id: string; title: string; children: ComponentChildren }) {
  return (
    <section class="part" id={id} aria-labelledby={`${id}-title`}>
      <h2 id={`${id}-title`}>{title}</h2>
      {children}
    </section>
  );
}

/** What the board shows, read again and again; `again()` reads it now. */
function useOverview(first: Overview, chosen: Chosen, ondenied: (problem: api.Problem) => void) {
  const [shown, setShown] = useState<Shown>({ overview: first, timeline: null, late: "" });
  const read = useRef(() => {});
  const scrolled = useRef(chosen.job);
  useEffect(() => {
    const controller = new AbortController();
    let timer = 0;
    let pause = EVERY_MS;
    const refresh = async () => {
      clearTimeout(timer);
      try {
        const overview = await ops.readOverview(chosen, controller.signal);
        const timeline = chosen.job ? await readTimeline(chosen.job, controller.signal) : null;
        if (controller.signal.aborted) return;
        setShown({ overview, timeline, late: "" });
        pause = EVERY_MS;
        if (timeline && scrolled.current !== chosen.job) scrollTo(chosen.job);
      } catch (error) {
        if (controller.signal.aborted) return;
        const problem = api.asProblem(error);
        if (problem.status === 403) return ondenied(problem);
        setShown((old) => ({ ...old, late: problem.message }));
        pause = Math.min(LONGEST_MS, 2 * pause);
      }
      clearTimeout(timer);
      if (!document.hidden) timer = window.setTimeout(refresh, pause);
    };
    const scrollTo = (job: string | null) => {
      scrolled.current = job;
      requestAnimationFrame(() =>
        document.getElementById("timeline")?.scrollIntoView({ behavior: "smooth", block: "nearest" }),
      );
    };
    read.current = refresh;
    timer = window.setTimeout(refresh, chosen.search ? TYPING_MS : 0);
    document.addEventListener(
      "visibilitychange",
      () => (document.hidden ? clearTimeout(timer) : refresh()),
      controller,
    );
    return () => {
      controller.abort();
      clearTimeout(timer);
    };
  }, [chosen]);
  return { shown, again: () => read.current() };
}

/** A job and its attempts; null if it was deleted. */
async function readTimeline(id: string, signal: AbortSignal): Promise<Shown["timeline"]> {
  try {
    const [job, bars] = await Promise.all([api.job(id, signal), ops.timeline(id, signal)]);
    return { job, bars };
  } catch (error) {
    if (error instanceof api.Problem && error.status === 404) return null;
    throw error;
  }
}

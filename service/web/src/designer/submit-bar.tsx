/** The bottom of the panel: frames, estimated time, jobs ahead, and the buttons that submit. */

import { useEffect, useState } from "preact/hooks";
import * as api from "../shared/api";
import { duration } from "../shared/format";
import type { Output } from "../shared/types";
import { checkProject, type Estimate, estimate, submitProject } from "./api";
import { CLUSTER_ARTEFACTS } from "./clusters";
import type { Store } from "./store";

const REST_MS = 1500;
const SHORT_S = 2;

export function SubmitBar({ store, saveAll }: { store: Store; saveAll(): Promise<boolean> }) {
  const [problem, setProblem] = useState("");
  const [sending, setSending] = useState(false);
  const found = useEstimate(store);
  const short = Math.min(store.frames, Math.round(SHORT_S * store.fps));

  async function send(range?: [number, number]): Promise<void> {
    setSending(true);
    setProblem("");
    try {
      await submitFilm(store, saveAll, range);
    } catch (error) {
      const { message, remedy } = api.asProblem(error);
      setProblem([message, remedy].filter(Boolean).join(" "));
    }
    setSending(false);
  }

  const from = Math.max(0, Math.min(store.frame.value, store.frames - short));
  return (
    <div class="submit-bar designer-submit">
      <div class="submit-hint">
        <span>{store.frames} frames</span>
        {found && <span>{estimateText(found)}</span>}
        <p class="field-error" role="alert">
          {problem}
        </p>
      </div>
      {short < store.frames && (
        <button type="button" class="button" disabled={sending} onClick={() => send([from, from + short])}>
          Paint {SHORT_S} s first
        </button>
      )}
      <button type="button" class="button primary submit" disabled={sending} onClick={() => send()}>
        Paint the film
      </button>
    </div>
  );
}

/** Save the project, submit its film, and show the job. Throws a Problem if something keeps it from that. */
export async function submitFilm(
  store: Store,
  saveAll: () => Promise<boolean>,
  range?: [number, number],
): Promise<void> {
  if (!(await saveAll()))
    throw new api.Problem({ detail: "The project is not saved.", remedy: "See the message above the stage." });
  const faults = await checkProject(store.projectId);
  const fault = faults[0];
  if (fault) throw new api.Problem({ detail: fault.message, remedy: fault.remedy });
  const output = withClusters(store);
  const [first] = await submitProject(
    store.projectId,
    { ...(range && { range }), ...(output && { output }) },
    api.token(),
  );
  if (first) location.hash = `#/jobs/${first.job.id}`;
}

/** The output with the clusters, which the studio shows later; undefined: as the document has it. */
function withClusters(store: Store): Output | undefined {
  const [only, ...others] = store.shot.value.layers.filter((layer) => layer.visible !== false);
  const plain = only && !others.length && (only.opacity ?? 1) === 1 && (only.blend ?? "over") === "over" && !only.matte;
  if (!plain || only.method !== "patches" || store.document.value.shots.length > 1) return undefined;
  const { output = {} } = store.document.value;
  return { ...output, artefacts: [...new Set([...(output.artefacts ?? []), ...CLUSTER_ARTEFACTS])] };
}

function estimateText({ items, jobs_ahead: ahead }: Estimate): string {
  const seconds = items.reduce<number | null>(
    (sum, item) => (sum === null || item.seconds === null ? null : sum + item.seconds),
    0,
  );
  const time = seconds === null ? "time unknown until a first film is finished" : `about ${duration(seconds)}`;
  return [time, ahead ? `${ahead} ${ahead === 1 ? "job" : "jobs"} ahead` : ""].filter(Boolean).join(" · ");
}

/** The service's estimate for the saved project; null where it gives none. */
function useEstimate(store: Store): Estimate | null {
  const [found, setFound] = useState<Estimate | null>(null);
  const saved = store.saving.value.name === "saved";
  const document = store.document.value;
  useEffect(() => {
    if (!saved) return;
    const timer = setTimeout(() => estimate(store.projectId).then(setFound, () => setFound(null)), REST_MS);
    return () => clearTimeout(timer);
  }, [saved, document]);
  return found;
}

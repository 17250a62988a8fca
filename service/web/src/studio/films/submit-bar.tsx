/** The bottom of the panel: the film that is painted now; frames, estimated time, jobs ahead, the buttons that submit. */

import { useEffect, useState } from "preact/hooks";
import * as api from "../../api/api";
import { duration } from "../../ui/format";
import { type Estimate, estimate } from "../document/api";
import type { Store } from "../state/store";
import { FilmProgress } from "./film-progress";
import type { Films } from "./films";

const REST_MS = 1500;
const SHORT_S = 2;

interface SubmitBarProps {
  store: Store;
  films: Films;
  saveAll(): Promise<boolean>;
}

export function SubmitBar({ store, films, saveAll }: SubmitBarProps) {
  const [problem, setProblem] = useState("");
  const [sending, setSending] = useState(false);
  const found = useEstimate(store);
  const [first, end] = store.shot.value.range ?? [0, store.frames];
  const short = Math.min(store.frames, Math.round(SHORT_S * store.fps));

  async function send(range?: [number, number]): Promise<void> {
    if (sending) return; // a disabled button would lose the focus
    setSending(true);
    setProblem("");
    try {
      await films.submit(saveAll, range);
    } catch (error) {
      const { message, remedy } = api.asProblem(error);
      setProblem([message, remedy].filter(Boolean).join(" "));
    }
    setSending(false);
  }

  const from = Math.max(0, Math.min(store.frame.value, store.frames - short));
  return (
    <div class="submit-bar designer-submit">
      <FilmProgress store={store} films={films} />
      <div class="submit-hint">
        <span>{Math.min(end, store.frames) - first} frames</span>
        {found && <span>{estimateText(found)}</span>}
        <p class="field-error" role="alert">
          {problem}
        </p>
      </div>
      {short < store.frames && (
        <button type="button" class="button" aria-disabled={sending} onClick={() => send([from, from + short])}>
          Paint {SHORT_S} s first <small>from frame {from + 1}</small>
        </button>
      )}
      <button type="button" class="button primary submit" aria-disabled={sending} onClick={() => send()}>
        Paint the film
      </button>
    </div>
  );
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

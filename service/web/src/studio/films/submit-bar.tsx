/** The bottom of the panel: the film that is painted now; frames, estimated time, jobs ahead, the buttons that submit. */

import { useEffect, useState } from "preact/hooks";
import * as api from "../../api/api";
import { duration } from "../../ui/format";
import { type Estimate, estimate } from "../document/api";
import { framesOf } from "../document/shots";
import type { Store } from "../state/store";
import type { Film } from "./film";
import { FilmProgress } from "./film-progress";
import type { Films } from "./films";
import { WholeFilm } from "./whole-film";

const REST_MS = 1500;
const SHORT_S = 2;

interface SubmitBarProps {
  store: Store;
  film: Film;
  films: Films;
  saveAll(): Promise<boolean>;
}

export function SubmitBar({ store, film, films, saveAll }: SubmitBarProps) {
  const [problem, setProblem] = useState("");
  const [sending, setSending] = useState(false);
  const [wished, setLayer] = useState("");
  const layer = store.shot.value.layers.some(({ id }) => id === wished) ? wished : "";
  const found = useEstimate(store, film);
  const [first, end] = framesOf(store.shot.value, store.frames);
  const short = Math.min(end - first, Math.round(SHORT_S * store.fps));
  const shots = store.document.value.shots.length;

  async function send(range?: [number, number]): Promise<void> {
    if (sending) return; // a disabled button would lose the focus
    setSending(true);
    setProblem("");
    try {
      await films.submit(saveAll, range, layer);
    } catch (error) {
      const { message, remedy } = api.asProblem(error);
      setProblem([message, remedy].filter(Boolean).join(" "));
    }
    setSending(false);
  }

  const from = Math.max(first, Math.min(store.frame.value, end - short));
  return (
    <div class="submit-bar designer-submit">
      <WholeFilm film={film} session={store.session} />
      <FilmProgress store={store} films={films} />
      <div class="submit-hint">
        {!film.painting.value && <span>{shots > 1 ? shotsText(film, shots) : `${end - first} frames`}</span>}
        {!film.painting.value && found && <span>{estimateText(found)}</span>}
        <p class="field-error" role="alert">
          {problem}
        </p>
      </div>
      <Alone store={store} layer={layer} onchange={setLayer} />
      {short < end - first && (
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

interface AloneProps {
  store: Store;
  layer: string;
  onchange(layer: string): void;
}

/** Which layers the film shows: all visible ones, or one alone with its opacity; not for a single opaque layer. */
function Alone({ store, layer, onchange }: AloneProps) {
  const { layers } = store.shot.value;
  const [only] = layers;
  const opaque = !only?.matte && (only?.opacity ?? 1) === 1;
  if (layers.length < 2 && opaque) return null;
  const title = (method: string) => store.methods.find(({ name }) => name === method)?.title ?? method;
  return (
    <select
      class="film-layer"
      aria-label="Layers of the film"
      value={layer}
      onChange={({ currentTarget }) => onchange(currentTarget.value)}
    >
      <option value="">The film: all visible layers</option>
      {layers.map(({ id, name, method }) => (
        <option key={id} value={id}>{`${name || title(method)} alone, with its opacity`}</option>
      ))}
    </select>
  );
}

/** "2 of 6 shots to paint". */
function shotsText(film: Film, shots: number): string {
  const { length } = film.shots.value.length ? film.missing.value : { length: shots };
  return length ? `${length} of ${shots} shots to paint` : "All shots are painted";
}

function estimateText({ items, jobs_ahead: ahead }: Estimate): string {
  const seconds = items.reduce<number | null>(
    (sum, item) => (sum === null || item.seconds === null ? null : sum + item.seconds),
    0,
  );
  const time = seconds === null ? "time unknown until a first film is finished" : `about ${duration(seconds)}`;
  return [time, ahead ? `${ahead} ${ahead === 1 ? "job" : "jobs"} ahead` : ""].filter(Boolean).join(" · ");
}

/** The service's estimate for what is missing of the saved project's film; null where it gives none. */
function useEstimate(store: Store, film: Film): Estimate | null {
  const [found, setFound] = useState<Estimate | null>(null);
  const saved = store.saving.value.name === "saved";
  const document = store.document.value;
  const known = film.shots.value.length > 0;
  const missing = film.missing.value.map(({ shot }) => shot).join();
  useEffect(() => {
    if (!saved) return;
    const shots = known ? missing.split(",") : null;
    const timer = setTimeout(
      () =>
        known && !missing ? setFound(null) : estimate(store.projectId, shots).then(setFound, () => setFound(null)),
      REST_MS,
    );
    return () => clearTimeout(timer);
  }, [saved, document, known, missing]);
  return found;
}

/** The finished film in other formats: converted by the service on demand, then saved. */

import { useEffect, useRef, useState } from "preact/hooks";
import * as api from "../api/api";
import { outputOf } from "../api/formats";
import type { Job, OutputName } from "../api/schemas";
import { type Encoding, EncodingSelect, encodings, sameEncoding } from "../forms/encoding-select";
import { percent } from "../ui/format";
import { announce, notify } from "../ui/notices";

const POLL_MS = 700;

/** Encodings that a film can be exported in, besides its own: none for a coarse one. */
export function exportsOf(own: Job["request"]["output"]): Encoding[] {
  const form = outputOf(own?.format);
  const made = { format: form.name, profile: own?.profile || (form.profiles[0]?.name ?? "") };
  return form.lossy ? [] : encodings().filter((one) => !sameEncoding(one, made));
}

/** Settings of encodings with loss, and their rate factors. */
const QUALITIES: [string, number][] = [
  ["Nothing visible is lost", 12],
  ["Fine", 20],
  ["Small file", 30],
];
const USUAL_QUALITY = 20;

/** What the exports of a film of a format contain. */
export const exportsHint = (own: OutputName | undefined): string =>
  outputOf(own).shownAs === "video"
    ? `Exports are converted from this ${outputOf(own).file} film. Its PNG frames are the film's decoded frames, which differ from the painted ones by a few levels of 255. For the painted frames themselves, paint the film as PNG frames.`
    : "Exports are converted from the painted frames.";

/** The choice of an encoding, of its quality if it has one, and the button that converts and saves. */
export function Exports({ job }: { job: Job }) {
  const offered = exportsOf(job.request.output);
  const [chosen, setChosen] = useState<Encoding | undefined>(offered[0]);
  const [quality, setQuality] = useState(USUAL_QUALITY);
  const [done, setDone] = useState<number | null>(null);
  const life = useRef(new AbortController());
  useEffect(() => () => life.current.abort(), []);
  if (!chosen) return null;
  const profile = outputOf(chosen.format).profiles.find(({ name }) => name === chosen.profile);
  const save = async () => {
    setDone(0);
    try {
      const wanted = { ...chosen, ...(profile?.hasQuality && { quality }) };
      const made = await converted(job, wanted, life.current.signal, setDone);
      announce(`${outputOf(chosen.format).title} is ready.`);
      await api.download(api.paths.result(made.id));
    } catch (error) {
      notify(error);
    }
    setDone(null);
  };
  return (
    <div class="exports" role="group" aria-label="Export as">
      <span>Export as</span>
      <EncodingSelect label="Encoding of the export" value={chosen} offered={offered} onchange={setChosen} />
      {profile?.hasQuality && (
        <select
          aria-label="Quality of the export"
          value={quality}
          onChange={({ currentTarget }) => setQuality(Number(currentTarget.value))}
        >
          {QUALITIES.map(([title, value]) => (
            <option key={value} value={value}>
              {title}
            </option>
          ))}
        </select>
      )}
      <button type="button" class="button small" disabled={done !== null} onClick={save}>
        {done === null ? "Export" : `Export, ${percent(done)}`}
      </button>
      <p class="hint">{exportsHint(job.request.output?.format)}</p>
    </div>
  );
}

/** The finished export. Throws a Problem if it fails. */
async function converted(
  job: Job,
  wanted: Encoding & { quality?: number },
  signal: AbortSignal,
  progress: (done: number) => void,
): Promise<Job> {
  const answer = await api.post(api.url`/v1/jobs/${job.id}/exports`, wanted, { signal });
  let made: Job = await answer.json();
  while (!["succeeded", "failed", "cancelled"].includes(made.state)) {
    progress(made.progress);
    await new Promise((done) => setTimeout(done, POLL_MS));
    made = await api.job(made.id, signal);
  }
  if (made.state === "succeeded") return made;
  const { message = "The export was cancelled.", remedy = "Try it again." } = made.error ?? {};
  throw new api.Problem({ title: "Not exported", detail: message, remedy });
}

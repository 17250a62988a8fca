/** The finished film in other formats: converted by the service on demand, then saved. */

import { useEffect, useRef, useState } from "preact/hooks";
import * as api from "../api/api";
import { outputOf, outputs } from "../api/formats";
import type { Job, OutputName } from "../api/schemas";
import { percent } from "../ui/format";
import { announce, notify } from "../ui/notices";

const POLL_MS = 700;

/** Names of formats that a film can be exported in, besides its own: none for a coarse one. */
export const exportsOf = (own: OutputName | undefined): OutputName[] =>
  outputOf(own).lossy ? [] : outputs.map(({ name }) => name).filter((name) => name !== outputOf(own).name);

/** What the exports of a film of a format contain. */
export const exportsHint = (own: OutputName | undefined): string =>
  outputOf(own).shownAs === "video"
    ? `Exports are converted from this ${outputOf(own).file} film. Its PNG frames are the film's decoded frames, which differ from the painted ones by a few levels of 255. For the painted frames themselves, paint the film as PNG frames.`
    : "Exports are converted from the painted frames.";

/** Buttons for the other formats. */
export function Exports({ job }: { job: Job }) {
  const offered = exportsOf(job.request.output?.format);
  if (!offered.length) return null;
  return (
    <div class="exports" role="group" aria-label="Export as">
      <span>Export as</span>
      {outputs
        .filter(({ name }) => offered.includes(name))
        .map(({ name, title, help }) => (
          <ExportButton key={name} job={job} format={name} title={title} help={help} />
        ))}
      <p class="hint">{exportsHint(job.request.output?.format)}</p>
    </div>
  );
}

function ExportButton({ job, format, title, help }: { job: Job; format: OutputName; title: string; help: string }) {
  const [done, setDone] = useState<number | null>(null);
  const life = useRef(new AbortController());
  useEffect(() => () => life.current.abort(), []);
  const save = async () => {
    setDone(0);
    try {
      const made = await converted(job, format, life.current.signal, setDone);
      announce(`${title} is ready.`);
      await api.download(api.paths.result(made.id));
    } catch (error) {
      notify(error);
    }
    setDone(null);
  };
  return (
    <button type="button" class="button small" title={help} disabled={done !== null} onClick={save}>
      {done === null ? title : `${title}, ${percent(done)}`}
    </button>
  );
}

/** The finished export. Throws a Problem if it fails. */
async function converted(
  job: Job,
  format: OutputName,
  signal: AbortSignal,
  progress: (done: number) => void,
): Promise<Job> {
  const answer = await api.post(api.url`/v1/jobs/${job.id}/exports`, { format }, { signal });
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

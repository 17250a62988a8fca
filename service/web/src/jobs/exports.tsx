/** The finished film in other formats: converted by the service on demand, then saved. */

import { useEffect, useRef, useState } from "preact/hooks";
import * as api from "../api/api";
import type { Job, Output } from "../api/schemas";
import { percent } from "../ui/format";
import { announce, notify } from "../ui/notices";

type Format = NonNullable<Output["format"]>;

const POLL_MS = 700;
const FORMATS: [Format, string, string][] = [
  ["mp4", "MP4", "Plays everywhere"],
  ["webm", "WebM", "Free of patents"],
  ["png", "PNG frames", "The film's frames as pictures, in a zip"],
  ["gif", "GIF", "At most 720 px, 256 colours, without sound"],
];

/** Formats that a film can be exported in, besides its own: none for a GIF. */
export const exportsOf = (own: Format): Format[] =>
  own === "gif" ? [] : FORMATS.map(([format]) => format).filter((format) => format !== own);

/** Buttons for the other formats. */
export function Exports({ job }: { job: Job }) {
  const offered = exportsOf(job.request.output?.format ?? "mp4");
  if (!offered.length) return null;
  return (
    <div class="exports" role="group" aria-label="Export as">
      <span>Export as</span>
      {FORMATS.filter(([format]) => offered.includes(format)).map(([format, title, help]) => (
        <ExportButton key={format} job={job} format={format} title={title} help={help} />
      ))}
    </div>
  );
}

function ExportButton({ job, format, title, help }: { job: Job; format: Format; title: string; help: string }) {
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
  format: Format,
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

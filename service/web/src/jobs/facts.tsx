/** Folded sections of the job page: the settings used, the time of each stage, and the same job by link or command. */

import type { ComponentChildren } from "preact";
import { useEffect, useState } from "preact/hooks";
import * as api from "../api/api";
import type { Asset, Job, Params, Step } from "../api/schemas";
import { duration, humanise } from "../ui/format";
import { useObjectUrl } from "../ui/media";
import { announce, notify } from "../ui/notices";
import { ownLabels } from "./job-list";
import { commandLine, curlLine, pythonLine } from "./recipes";

type Pair = [name: string, value: ComponentChildren];

export function Facts({ job }: { job: Job }) {
  const timed = job.steps.filter((step) => Object.keys(step.stages ?? {}).length);
  const inputs = Object.entries(job.request.inputs).filter(([name]) => name !== "video");
  return (
    <div class="facts">
      <Details title="Settings" pairs={settings(job)}>
        {inputs.length > 0 && (
          <div class="fact-inputs">
            {inputs.map(([name, id]) => (
              <InputPicture key={name} name={name} id={id} />
            ))}
          </div>
        )}
      </Details>
      {timed.length > 0 && <Details title="Timings" pairs={timed.flatMap(timings)} />}
      <Copies job={job} />
    </div>
  );
}

function Details({ title, pairs, children }: { title: string; pairs: Pair[]; children?: ComponentChildren }) {
  return (
    <details class="group">
      <summary>
        <span>{title}</span>
      </summary>
      {children}
      <dl class="pairs">
        {pairs.map(([name, value], i) => (
          <div key={`${name}-${i}`}>
            <dt>{name}</dt>
            <dd>{value}</dd>
          </div>
        ))}
      </dl>
    </details>
  );
}

function settings(job: Job): Pair[] {
  const { id, request, created_at: created, finished_at: finished } = job;
  const params = Array.isArray(request.params.layers) ? layers(request.params.layers) : rows(request.params);
  const all: (Pair | false | undefined | null | "")[] = [
    ["Method", humanise(request.method)],
    ...(params.length ? params : [["Parameters", "defaults"] as Pair]),
    request.frames && ["Frames", `${request.frames[0] + 1} to ${request.frames[1]}`],
    ["Seed", String(request.seed)],
    request.output?.format && ["Format", request.output.format.toUpperCase()],
    finished !== null && ["Took", duration(finished - created)],
    ...ownLabels(job).map((label): Pair => ["Label", label]),
    ["Job", <code key="id">{id}</code>],
  ];
  return all.filter((pair): pair is Pair => Boolean(pair));
}

const rows = (params: Params): Pair[] =>
  Object.entries(params).map(([name, value]) => [
    humanise(name),
    typeof value === "object" ? JSON.stringify(value) : String(value),
  ]);

/** The layers of a job that has several, the topmost first. */
function layers(listed: Params[]): Pair[] {
  const of = ({ method, opacity, blend }: Params) =>
    [humanise(String(method)), `${Math.round(100 * Number(opacity ?? 1))} %`, blend === "over" ? "" : blend]
      .filter(Boolean)
      .join(", ");
  return listed.map((layer, i): Pair => [`Layer ${i + 1}`, of(layer)]).reverse();
}

/** A picture that the job was given besides its video, for example the painting. */
function InputPicture({ name, id }: { name: string; id: string }) {
  const [asset, setAsset] = useState<Asset | null>(null);
  useEffect(() => {
    api.asset(id).then(setAsset, notify);
  }, [id]);
  const shown = asset && ["image", "video"].includes(asset.kind);
  const src = useObjectUrl(shown ? api.paths.frame(id, 0, 240) : "");
  return (
    <figure>
      {src && <img src={src} alt={asset?.filename ?? ""} />}
      <figcaption>{humanise(name)}</figcaption>
    </figure>
  );
}

const timings = (step: Step): Pair[] => [
  ...Object.entries(step.stages).map(
    ([stage, seconds]): Pair => [`${step.title}: ${humanise(stage).toLowerCase()}`, duration(seconds)],
  ),
  ...(step.cpu_s ? [[`${step.title}: processor time`, duration(step.cpu_s)] as Pair] : []),
  ...(step.peak_bytes ? [[`${step.title}: largest memory`, `${Math.round(step.peak_bytes / 1e6)} MB`] as Pair] : []),
];

function Copies({ job }: { job: Job }) {
  const ways: [string, string][] = [
    ["Link", location.href],
    ["curl", curlLine(job, location.origin)],
    ["Python", pythonLine(job, location.origin)],
    ["Command", commandLine(job)],
  ];
  return (
    <div class="copies" role="group" aria-label="Copy this job as">
      <span>Copy as</span>
      {ways.map(([title, text]) => (
        <button key={title} type="button" class="button small" onClick={() => copy(title, text)}>
          {title}
        </button>
      ))}
    </div>
  );
}

async function copy(title: string, text: string): Promise<void> {
  try {
    await navigator.clipboard.writeText(text);
    announce(`${title} copied.`);
  } catch {
    const remedy = "The browser does not allow it here: mark the text and copy it.";
    notify(new api.Problem({ title: "Not copied", detail: text, remedy }));
  }
}

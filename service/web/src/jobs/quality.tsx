/** The quality report of a finished job: its figures, and flicker over time. A bar shows its frame in the player. */

import { useEffect, useState } from "preact/hooks";
import * as api from "../api/api";
import type { Job } from "../api/schemas";
import { notify } from "../ui/notices";

interface Sample {
  frame: number;
  flicker: number;
  detail: number;
  structure: number;
}

export interface Quality {
  pairs: number;
  flicker: number | null;
  detail: number | null;
  structure: number | null;
  edge_width_px?: number | null;
  /** Faces found in the source; null: they were not searched. */
  faces?: number | null;
  faces_kept?: number | null;
  palette_distance?: number;
  flicker_of_alone?: number;
  samples: Sample[];
  worst: number[];
}

type Row = [title: string, value: string, meaning: string];

/** Nothing if the job was not asked for a report, or as long as it is not read. */
export function QualityReport({ job, showFrame }: { job: Job; showFrame(frame: number): void }) {
  const [quality, setQuality] = useState<Quality | null>(null);
  const asked = job.request.output?.report;
  useEffect(() => {
    const report = api.paths.file(job.id, "report");
    if (asked) api.get<{ quality?: Quality }>(report).then((read) => setQuality(read.quality ?? null), notify);
  }, [job.id]);
  if (!asked) return null;
  return (
    <section class="quality" aria-label="Quality">
      {quality?.pairs ? <Report quality={quality} showFrame={showFrame} /> : null}
    </section>
  );
}

interface PartProps {
  quality: Quality;
  showFrame(frame: number): void;
}

function Report({ quality, showFrame }: PartProps) {
  return (
    <>
      <h2>Quality</h2>
      <dl class="quality-figures">
        {rows(quality).map(([title, value, meaning]) => (
          <div key={title}>
            <dt>{title}</dt>
            <dd>
              <strong>{value}</strong> <small>{meaning}</small>
            </dd>
          </div>
        ))}
      </dl>
      {notesOnFaces(quality).map((note) => (
        <p key={note}>{note}</p>
      ))}
      <p>{`Flicker of ${count(quality.pairs, "measured frame")}. Select a bar to see its frame.`}</p>
      <Chart quality={quality} showFrame={showFrame} />
      <WorstMoments quality={quality} showFrame={showFrame} />
    </>
  );
}

const count = (n: number, thing: string): string => `${n} ${thing}${n === 1 ? "" : "s"}`;

/** The figures that were measured, in words. */
export function rows(quality: Quality): Row[] {
  const all: [string, number | null | undefined, string, string][] = [
    ["Flicker", quality.flicker, "", "1 = as steady as the source, less is steadier"],
    ["Detail", quality.detail, "", "1 = as much as the source"],
    ["Structure", quality.structure, "", "1 = the scene reads as in the source"],
    ["Edge width", quality.edge_width_px, " px", "1 to 2 px = drawn at this size"],
    ["Flicker, of frame by frame", quality.flicker_of_alone, "", "1 = as much as frames painted one by one"],
    ["Palette distance", quality.palette_distance, "", "0 = only colours of the style, of 442"],
    ["Faces kept", quality.faces_kept, "", `of ${quality.faces ?? 0} faces found in the source`],
  ];
  return all.flatMap(([title, value, unit, meaning]): Row[] =>
    value === null || value === undefined ? [] : [[title, `${value.toFixed(2)}${unit}`, meaning]],
  );
}

/** Why there is no share of faces kept, if so. */
export function notesOnFaces({ faces }: Quality): string[] {
  if (faces === null) return ["Faces were not searched: that takes too long beside so short a render."];
  return faces === 0 ? ["No frontal face was found in the source."] : [];
}

/** Buttons that show the frames with the most flicker. */
function WorstMoments({ quality: { worst, samples }, showFrame }: PartProps) {
  const flicker = new Map(samples.map((sample) => [sample.frame, sample.flicker]));
  return (
    <div class="quality-worst" role="group" aria-label="Frames with the most flicker">
      <span>Most flicker:</span>
      {worst.map((frame) => (
        <button key={frame} type="button" class="chip-button" onClick={() => showFrame(frame)}>
          {`Frame ${frame + 1} · ${(flicker.get(frame) ?? 0).toFixed(2)}`}
        </button>
      ))}
    </div>
  );
}

function Chart({ quality: { worst, samples }, showFrame }: PartProps) {
  const most = Math.max(1, ...samples.map((sample) => sample.flicker));
  return (
    <div class="quality-chart" role="group" aria-label="Flicker over time">
      {samples.map(({ frame, flicker }) => (
        <button
          key={frame}
          type="button"
          class={`quality-bar ${worst.includes(frame) ? "worst" : ""}`}
          title={`Frame ${frame + 1}: flicker ${flicker.toFixed(2)}`}
          aria-label={`Frame ${frame + 1}: flicker ${flicker.toFixed(2)}`}
          style={{ "--share": flicker / most }}
          onClick={() => showFrame(frame)}
        />
      ))}
    </div>
  );
}

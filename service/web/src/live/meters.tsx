/** The figures under the picture: one number each, and the graph of the last minute. */

import type { Second } from "./figures";
import { Graph } from "./graph";
import { sizeSentence } from "./size-sentence";
import type { SizeReason } from "./types";

const NONE = "–";
const ms = (value: number | null): string => (value === null ? NONE : String(Math.round(value)));
const megabits = (bytes: number): string => `${((8 * bytes) / 1e6).toFixed(1)}`;

/** Of a `stats` or `resolution` message. */
export interface Painted {
  width: number;
  height: number;
  scale: number;
  size?: SizeReason;
  stages_ms?: Record<string, number>;
}

export interface MetersProps {
  /** The last minute, the present second last. */
  history: readonly Second[];
  /** Share of frames dropped in the last ten seconds, 0..1. */
  dropShare: number;
  targetFps: number;
  painted: Painted | null;
  codecs: string;
}

/** Folded on a phone, where the settings matter more. */
export function Meters({ history, dropShare, targetFps, painted, codecs }: MetersProps) {
  const second = history.at(-1);
  const rate = second?.offered ? second.fps.toFixed(second.fps < 9.95 ? 1 : 0) : NONE;
  const dropped = second ? (100 * dropShare).toFixed(dropShare > 0 && dropShare < 0.1 ? 1 : 0) : NONE;
  return (
    <details class="group live-figures" open={!matchMedia("(max-width: 720px)").matches}>
      <summary>
        <span>Figures</span>
      </summary>
      <div class="live-meters">
        <dl class="live-tiles">
          <Tile title="Rate" unit="fps" ink="viridian" value={rate} about="Painted frames shown in the last second." />
          <Tile
            title="Delay"
            unit="ms"
            ink="vermilion"
            value={ms(second?.glassMs ?? null)}
            about="From the camera's frame to its painting on this screen: the median of the last second."
          />
          <Tile
            title="Service"
            unit="ms"
            ink="ultramarine"
            value={ms(second?.serverMs ?? null)}
            about="Time in the service: from a frame received to its answer sent."
          />
          <Tile
            title="Dropped"
            unit="%"
            ink="alarm"
            value={dropped}
            about="Frames of the last ten seconds that were left out, by this page or by the service, so that the delay does not grow."
          />
          <Tile
            title="Painted at"
            value={painted ? `${painted.width} × ${painted.height}` : NONE}
            about="The size at which the service paints now; it is reduced when frames take too long."
          />
        </dl>
        <p class="live-why" role="status">
          {painted?.size && sizeSentence(painted.scale, painted.size)}
        </p>
        <Graph history={history} targetFps={targetFps} />
        <details class="live-more">
          <summary>Time of each stage</summary>
          <dl class="pairs">
            {pairs(second, painted, codecs).map(([name, value]) => (
              <div key={name}>
                <dt>{name}</dt>
                <dd>{value}</dd>
              </div>
            ))}
          </dl>
        </details>
      </div>
    </details>
  );
}

function pairs(second: Second | undefined, painted: Painted | null, codecs: string): [string, string][] {
  const all: [string, string][] = [
    ["Codecs", codecs],
    ["Network", second ? `${megabits(second.upBytes)} Mbit/s up, ${megabits(second.downBytes)} Mbit/s down` : ""],
    ["Scale", painted ? `${Math.round(painted.scale * 100)} %` : ""],
    ...Object.entries(painted?.stages_ms ?? {}).map(([name, value]): [string, string] => [
      STAGES[name] ?? name,
      `${value.toFixed(1)} ms`,
    ]),
  ];
  return all.filter(([, value]) => value);
}

/** Stages by their names in the protocol. */
const STAGES: Record<string, string> = {
  wait: "Queued",
  decode: "Decoding",
  analyze: "Analysis: motion and importance",
  paint: "Painting",
  filter: "Removing flicker",
  encode: "Encoding",
};

interface TileProps {
  title: string;
  unit?: string;
  ink?: string;
  value: string;
  about: string;
}

function Tile({ title, unit, ink, value, about }: TileProps) {
  return (
    <div class="live-tile" title={about} data-ink={ink}>
      <dt>{title}</dt>
      <dd>
        <span class="live-number">{value}</span>
        {unit && <small>{unit}</small>}
      </dd>
    </div>
  );
}

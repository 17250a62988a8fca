/** A colour scheme drawn by hand: bars of hues over the outline of the video's own, and sliders for its tone. */

import { useRef, useState } from "preact/hooks";
import type { Schema } from "../api/schemas";
import { Icon } from "../ui/icons";
import { notify } from "../ui/notices";
import { pixelsOf } from "../ui/palette";
import { type ColourScheme, drawn, HUES, rounded, schemeOf } from "./colour-scheme";
import { Form } from "./schema-form";

const [WIDTH, HEIGHT] = [HUES * 10, 120];
/** By which a key of the keyboard changes a weight. */
const STEP = 0.05;

export interface SchemeEditorProps {
  /** What is painted with; null: the video's own colours. */
  scheme: ColourScheme | null;
  /** That of the video; null: not known. */
  source: ColourScheme | null;
  /** `group`: changes of the same one follow each other quickly. */
  onChange(scheme: ColourScheme | null, group: string): void;
}

const GRAY: ColourScheme = { hue: Array(HUES).fill(0), saturation_mean: 0.4, saturation_std: 0.2, value_mean: 0.5 };

export function SchemeEditor({ scheme, source, onChange }: SchemeEditorProps) {
  const start = scheme ?? source ?? GRAY;
  const fromPicture = (file: File | undefined) => {
    if (!file) return;
    const take = (data: Uint8ClampedArray) => {
      const found = schemeOf([data]);
      if (!found) throw new Error("The picture has no hues: all of it is gray.");
      onChange(found, "");
    };
    pixelsOf(file).then(take).catch(notify);
  };
  return (
    <div class="scheme-editor">
      <Histogram
        hue={start.hue}
        own={Boolean(scheme)}
        source={source?.hue ?? null}
        onChange={(hue) => onChange({ ...start, hue }, "hues")}
      />
      <div class="actions">
        <button
          type="button"
          class="button small"
          disabled={!source}
          onClick={() => source && onChange({ ...source }, "")}
        >
          <Icon name="film" />
          From the video
        </button>
        <label class="button small file-button">
          <Icon name="image" />
          From a picture
          <input
            type="file"
            accept="image/*"
            aria-label="Colour scheme from a picture"
            onChange={({ currentTarget }) => {
              fromPicture(currentTarget.files?.[0]);
              currentTarget.value = "";
            }}
          />
        </label>
        {scheme && (
          <button type="button" class="button small" onClick={() => onChange(null, "")}>
            <Icon name="trash" />
            Remove the scheme
          </button>
        )}
      </div>
      {scheme && <Tone scheme={scheme} source={source ?? GRAY} onChange={(changed) => onChange(changed, "tone")} />}
    </div>
  );
}

interface HistogramProps {
  hue: readonly number[];
  /** Whether the bars are a scheme, not the video's hues. */
  own: boolean;
  source: readonly number[] | null;
  onChange(hue: number[]): void;
}

/** Bars that are drawn with the pen; with the keyboard, Left and Right choose a hue, Up and Down change its weight. */
function Histogram({ hue, own, source, onChange }: HistogramProps) {
  const last = useRef<[number, number] | null>(null);
  const now = useRef(hue);
  now.current = hue;
  const [chosen, setChosen] = useState(0);
  const most = Math.max(...hue, 0.001);
  const at = (event: PointerEvent): [number, number] => {
    const box = (event.currentTarget as Element).querySelector("svg")?.getBoundingClientRect() ?? new DOMRect();
    return [(event.clientX - box.left) / box.width, 1 - (event.clientY - box.top) / box.height];
  };
  const point = (event: PointerEvent) => {
    const target = event.currentTarget as Element;
    if (event.type === "pointerdown") {
      target.setPointerCapture(event.pointerId);
      last.current = at(event);
    } else if (!last.current) return;
    const to = at(event);
    now.current = drawn(
      now.current.map((weight) => weight / Math.max(...now.current, 0.001)),
      last.current,
      to,
    );
    last.current = to;
    setChosen(Math.min(HUES - 1, Math.max(0, Math.floor(to[0] * HUES))));
    onChange([...now.current]);
  };
  const press = (event: KeyboardEvent) => {
    const along = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    const up = { ArrowUp: STEP, ArrowDown: -STEP }[event.key];
    if (!along && !up) return;
    event.preventDefault();
    if (along) setChosen((chosen + along + HUES) % HUES);
    if (up) {
      const x = (chosen + 0.5) / HUES;
      const weight = (hue[chosen] ?? 0) + up;
      onChange(drawn(hue, [x, weight], [x, weight]));
    }
  };
  const end = () => {
    last.current = null;
  };
  const weight = rounded((hue[chosen] ?? 0) / most);
  return (
    <div
      class="histogram"
      role="slider"
      tabIndex={0}
      aria-label="Hues of the painting: Left and Right choose one, Up and Down change its weight"
      aria-valuemin={0}
      aria-valuemax={1}
      aria-valuenow={weight}
      aria-valuetext={`Hue ${chosen * 10}°, weight ${weight}`}
      onPointerDown={point}
      onPointerMove={point}
      onPointerUp={end}
      onPointerCancel={end}
      onKeyDown={press}
    >
      <svg viewBox={`0 0 ${WIDTH} ${HEIGHT}`} preserveAspectRatio="none" aria-hidden="true">
        {hue.map((one, index) => (
          <rect
            key={HUE_NAMES[index]}
            class={index === chosen ? "chosen" : ""}
            x={10 * index + 0.5}
            width={9}
            y={HEIGHT * (1 - one / most)}
            height={(HEIGHT * one) / most}
            fill={`hsl(${10 * index} 75% 50%)`}
            opacity={own ? 1 : 0.45}
          />
        ))}
        {own && source && <polyline class="source-hues" points={outline(source)} />}
      </svg>
    </div>
  );
}

const HUE_NAMES = Array.from({ length: HUES }, (_, index) => `hue-${10 * index}`);

/** The tops of the video's bars. */
const outline = (hue: readonly number[]): string =>
  hue
    .flatMap((one, index) => [10 * index, 10 * index + 10].map((x) => `${x},${HEIGHT * (1 - one / Math.max(...hue))}`))
    .join(" ");

interface ToneProps {
  scheme: ColourScheme;
  /** Its tone is the default. */
  source: ColourScheme;
  onChange(scheme: ColourScheme): void;
}

function Tone({ scheme, source, onChange }: ToneProps) {
  const { hue, ...tone } = scheme;
  return (
    <Form schema={toneSchema(source)} values={tone} onChange={(values) => onChange({ ...source, ...values, hue })} />
  );
}

function toneSchema(source: ColourScheme): Schema {
  const share = (name: Exclude<keyof ColourScheme, "hue">, title: string, description: string): Schema => ({
    type: "number",
    minimum: 0,
    maximum: 1,
    default: source[name],
    title,
    description,
  });
  return {
    properties: {
      saturation_mean: share("saturation_mean", "Saturation", "How vivid the painting is on average."),
      saturation_std: share("saturation_std", "Range of saturation", "How far that varies: the standard deviation."),
      value_mean: share("value_mean", "Brightness", "Mean brightness; “Keep brightness” says how far it counts."),
    },
  };
}

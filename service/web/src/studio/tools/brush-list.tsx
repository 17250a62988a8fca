/** The set of brushes, with a stroke of each, own ones, and the settings of the chosen one. */

import { useEffect, useRef } from "preact/hooks";
import { IconButton } from "../../ui/icons";
import { notify } from "../../ui/notices";
import { Slider } from "../../ui/slider";
import { brushesOf } from "../drawing/brush-files";
import { ALL_BRUSHES, type BrushPreset } from "../drawing/brushes";
import { drawStroke } from "../drawing/stroke-drawing";
import { PaintBuffers } from "../drawing/stroke-mask";
import type { Sample } from "../drawing/strokes";
import { prepareTip } from "../drawing/tip-shape";
import type { Store } from "../state/store";
import { brushName } from "./brush-bar";
import { BrushForm } from "./brush-form";

/** Size of a preview, CSS px, and of the brush in it. */
const WIDTH = 132;
const HEIGHT = 34;
const SIZE = 20;

export function BrushList({ store }: { store: Store }) {
  const { ownBrushes, stabiliser } = store.drawing;
  const chosen = brushName(store);
  const add = (presets: readonly BrushPreset[]) => {
    const names = presets.map(({ name }) => name);
    ownBrushes.value = [...ownBrushes.value.filter(({ name }) => !names.includes(name)), ...presets];
    const [first] = presets;
    if (first) chooseBrush(store, first);
  };
  const open = (event: Event) => {
    const input = event.currentTarget as HTMLInputElement;
    const file = input.files?.[0];
    input.value = "";
    if (file) brushesOf(file).then(add, notify);
  };
  const remove = (preset: BrushPreset) => {
    ownBrushes.value = ownBrushes.value.filter((one) => one !== preset);
  };
  return (
    <>
      <ul class="brush-list" aria-label="Brushes">
        {[...ALL_BRUSHES, ...ownBrushes.value].map((preset) => (
          <li key={preset.name}>
            <button
              type="button"
              class="brush-row"
              aria-pressed={chosen === preset.name}
              onClick={() => chooseBrush(store, preset)}
            >
              <span>{preset.name}</span>
              <StrokePreview preset={preset} />
            </button>
            {ownBrushes.value.includes(preset) && (
              <IconButton name="trash" label={`Remove ${preset.name}`} onClick={() => remove(preset)} />
            )}
          </li>
        ))}
      </ul>
      <label class="button small file-button">
        Brush from a picture or .abr
        <input type="file" accept="image/*,.abr" aria-label="Brush from a picture or a brush set" onChange={open} />
      </label>
      <div class="drawing-fields">
        <Slider
          label="Stabiliser"
          min={0}
          max={80}
          value={stabiliser.value}
          text={stabiliser.value ? `${stabiliser.value} px` : "off"}
          onChange={(length) => {
            stabiliser.value = length;
          }}
        />
      </div>
      <BrushForm store={store} save={(preset) => add([preset])} />
    </>
  );
}

/** Use a brush with the chosen tool; its size follows the video's. */
export function chooseBrush(store: Store, { name, tip, size, opacity }: BrushPreset): void {
  const { eraser, smudge } = store.drawing;
  const chosen = { name, ...(tip && { tip }) };
  if (tip) prepareTip(tip);
  if (store.tool.peek() === "eraser") eraser.value = chosen;
  else if (store.tool.peek() === "smudge") smudge.value = chosen;
  else {
    const { color } = store.brush.peek();
    const scaled = Math.max(1, Math.round((size * Math.min(store.size.width, store.size.height)) / 1080));
    store.brush.value = { color, size: scaled, opacity, ...chosen };
    store.tool.value = "brush";
  }
}

/** A stroke of the brush in black, with growing and falling pressure. */
function StrokePreview({ preset }: { preset: BrushPreset }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    const element = canvas.current;
    const context = element?.getContext("2d");
    if (!element || !context) return;
    const ratio = Math.min(2, devicePixelRatio || 1);
    const size = { width: WIDTH * ratio, height: HEIGHT * ratio };
    Object.assign(element, size);
    const color = "#000000";
    const width = Math.min(SIZE, Math.max(4, preset.size / 2.4)) * ratio;
    const stroke = {
      kind: "brush" as const,
      color,
      size: width,
      opacity: preset.opacity,
      samples: wave(ratio),
      seed: 7,
    };
    drawStroke(context, { ...stroke, ...(preset.tip && { tip: preset.tip }) }, new PaintBuffers(size));
  }, [preset]);
  return <canvas ref={canvas} class="brush-preview" />;
}

function wave(ratio: number): Sample[] {
  return Array.from({ length: 41 }, (_, i): Sample => {
    const t = i / 40;
    const y = HEIGHT / 2 - (HEIGHT / 5) * Math.sin(2 * Math.PI * t);
    return [ratio * (12 + t * (WIDTH - 24)), ratio * y, 0.15 + 0.85 * Math.sin(Math.PI * t)];
  });
}

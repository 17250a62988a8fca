/** The settings of the chosen painting tool, above the stage. */

import type { Section } from "../../api/schemas";
import { IconButton } from "../../ui/icons";
import { Slider } from "../../ui/slider";
import type { PanelTab } from "../drawing/settings";
import { DRAWN_TOOLS, MATTE_TOOLS, type Store } from "../state/store";

/** The tip of the chosen tool, by its name. */
export const brushName = (store: Store): string => {
  const { eraser, smudge } = store.drawing;
  if (store.tool.value === "eraser") return eraser.value.name;
  if (store.tool.value === "smudge") return smudge.value.name;
  return store.brush.value.name ?? "Round";
};

export function BrushBar({ store }: { store: Store }) {
  const brush = store.brush.value;
  const tool = store.tool.value;
  const { editor, marks = [] } = store.painted() ?? {};
  const marking = editor === "marks";
  const coloured = ["brush", "fill", "picker", "object"].includes(tool);
  const matte = MATTE_TOOLS.includes(tool);
  const drawn = DRAWN_TOOLS.includes(tool) && !matte;
  const strength = tool === "smudge" ? "Strength" : "Opacity";
  const set = (change: Partial<typeof brush>) => {
    store.brush.value = { ...brush, ...change };
  };
  return (
    <div class={`brush-settings ${DRAWN_TOOLS.includes(tool) ? "drawn" : ""}`}>
      {drawn && !marking && <PanelButton store={store} tab="brush" label={`Brush: ${brushName(store)}`} />}
      {coloured && (marking ? <MarkSwitch store={store} marks={marks} /> : <Colours store={store} />)}
      {(DRAWN_TOOLS.includes(tool) || tool === "label") && (
        <Slider
          label="Size"
          name="Brush size"
          min={1}
          max={200}
          value={brush.size}
          text={`${brush.size} px`}
          onChange={(size) => store.resizeBrush(size)}
        />
      )}
      {(drawn || tool === "fill") && (
        <Slider
          label={strength}
          name={`Brush ${strength.toLowerCase()}`}
          min={5}
          max={100}
          value={100 * brush.opacity}
          text={`${Math.round(100 * brush.opacity)} %`}
          onChange={(opacity) => set({ opacity: opacity / 100 })}
        />
      )}
      {tool === "object" && (
        <span class="hint">Click an object, or drag a box around it; with Alt, it is taken away.</span>
      )}
      {matte && <span class="hint">Paint on the layer's matte; with Alt, brush and eraser change places.</span>}
      {tool === "fill" && <FillFields store={store} />}
      {tool === "smudge" && <span class="hint">Moves the paint of the layer that is chosen in the panel.</span>}
    </div>
  );
}

function PanelButton({ store, tab, label }: { store: Store; tab: PanelTab; label: string }) {
  const { panel } = store.drawing;
  return (
    <button
      type="button"
      class="button small"
      aria-expanded={panel.value === tab}
      onClick={() => {
        panel.value = panel.value === tab ? "" : tab;
      }}
    >
      {label}
    </button>
  );
}

function Colours({ store }: { store: Store }) {
  const { background } = store.drawing;
  return (
    <>
      <label>
        <span class="slider-label">Colour</span>
        <input
          type="color"
          value={store.brush.value.color}
          onInput={(event) => {
            store.brush.value = { ...store.brush.value, color: event.currentTarget.value };
          }}
        />
      </label>
      <span class="colour-pair">
        <IconButton name="swap" label="Swap with the background colour" keys="X" onClick={() => store.swapColours()} />
        <span class="swatch" style={{ background: background.value }} title={`Background colour ${background.value}`} />
      </span>
      <PanelButton store={store} tab="colour" label="Colours" />
    </>
  );
}

function FillFields({ store }: { store: Store }) {
  const { fill } = store.drawing;
  const set = (change: Partial<typeof fill.value>) => {
    fill.value = { ...fill.value, ...change };
  };
  const { tolerance, gap, layerOnly } = fill.value;
  return (
    <>
      <Slider
        label="Tolerance"
        name="Tolerance of the fill"
        min={0}
        max={128}
        value={tolerance}
        text={`${Math.round((100 * tolerance) / 255)} %`}
        onChange={(value) => set({ tolerance: value })}
      />
      <Slider
        label="Close gaps"
        min={0}
        max={24}
        value={gap}
        text={gap ? `up to ${gap} px` : "no"}
        onChange={(value) => set({ gap: value })}
      />
      <label>
        <input
          type="checkbox"
          checked={layerOnly}
          onChange={(event) => set({ layerOnly: event.currentTarget.checked })}
        />
        Look at the layer alone
      </label>
    </>
  );
}

/** What the brush marks. */
function MarkSwitch({ store, marks }: { store: Store; marks: Section["marks"] }) {
  return (
    <div class="views" role="group" aria-label="The brush marks">
      {marks.map(({ title, colour }) => (
        <button
          key={colour}
          type="button"
          aria-pressed={store.brushColor === colour}
          onClick={() => {
            store.brush.value = { ...store.brush.value, color: colour, opacity: 1 };
            if (store.tool.value !== "object") store.tool.value = "brush";
          }}
        >
          {title}
        </button>
      ))}
    </div>
  );
}

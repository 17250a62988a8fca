/** The tools beside the stage, and the settings of the brush. */

import type { Section } from "../../api/schemas";
import { percent } from "../../ui/format";
import type { IconName } from "../../ui/icons";
import { IconButton } from "../../ui/icons";
import type { Clusters } from "../clusters/clusters";
import { type Films, filmHas } from "../films/films";
import { regionsState } from "../regions/region-tool";
import type { Stage } from "../stage/stage";
import { PAINT_TOOLS, PAINTED_VIEWS, type Result, type StageView, type Store, type Tool } from "../state/store";

const TOOLS: Record<Tool, { icon: IconName; label: string; keys: string }> = {
  pan: { icon: "pan", label: "Move the view", keys: "V" },
  brush: { icon: "brush", label: "Brush", keys: "B" },
  eraser: { icon: "eraser", label: "Eraser", keys: "E" },
  smudge: { icon: "smudge", label: "Smudge", keys: "S" },
  fill: { icon: "fill", label: "Fill", keys: "G" },
  picker: { icon: "picker", label: "Pick a colour", keys: "I" },
  region: { icon: "select", label: "Pick regions", keys: "R" },
  lasso: { icon: "lasso", label: "Draw a region", keys: "" },
  direction: { icon: "arrow", label: "Direct the strokes", keys: "D" },
  label: { icon: "fill", label: "Paint cluster labels", keys: "" },
  loupe: { icon: "eye", label: "Loupe at full size", keys: "Z" },
};

/** Tools for the inputs of the layer's method. `regions`, `clusters`: whether the service can find or has found them. */
export function toolsOf(store: Store, regions: boolean, clusters: boolean): Tool[] {
  const { tools = [] } = store.method.value?.studio ?? {};
  return ["pan", ...tools.filter((tool) => (tool !== "region" || regions) && (tool !== "label" || clusters))];
}

interface ToolbarProps {
  store: Store;
  clusters: Clusters;
  stage: () => Stage | null;
}

export function Toolbar({ store, clusters, stage }: ToolbarProps) {
  const regions = store.previews.value && regionsState.value !== "missing";
  const chosen = toolsOf(store, regions, clusters.available.value);
  const tools: Tool[] = store.previews.value ? [...chosen, "loupe"] : chosen;
  return (
    <div class="toolbar" role="toolbar" aria-label="Tools" aria-orientation="vertical">
      {tools.map((tool) => (
        <IconButton
          key={tool}
          name={TOOLS[tool].icon}
          label={TOOLS[tool].label}
          keys={TOOLS[tool].keys}
          pressed={store.tool.value === tool}
          onClick={() => {
            store.tool.value = tool;
            if (tool === "label") clusters.shown.value = true;
          }}
        />
      ))}
      <hr />
      <IconButton
        name="undo"
        label="Undo"
        keys="Ctrl+Z"
        disabled={!store.history.value.past.length}
        onClick={() => store.undo()}
      />
      <IconButton
        name="redo"
        label="Redo"
        keys="Ctrl+Shift+Z"
        disabled={!store.history.value.future.length}
        onClick={() => store.redo()}
      />
      <hr />
      <IconButton name="zoom" label="Zoom in" keys="+" onClick={() => stage()?.zoom(1.25)} />
      <IconButton name="full" label="Show the whole frame" keys="0" onClick={() => stage()?.fit()} />
    </div>
  );
}

const VIEWS: [StageView, string][] = [
  ["source", "Original"],
  ["compare", "Compare"],
  ["onion", "Onion skin"],
  ["painted", "Painted"],
  ["flicker", "Flicker"],
  ["film", "Film"],
];

/** The bar above the stage: the view, or the brush settings while the user paints. */
export function StageBar({ store, films, onfull }: { store: Store; films: Films; onfull(): void }) {
  const painting = ["label", "brush", "eraser", "smudge", "fill"].includes(store.tool.value);
  return (
    <div class="stage-bar">
      {painting ? <BrushSettings store={store} /> : <ViewSwitch store={store} films={films} />}
      <StageState store={store} films={films} onfull={onfull} />
    </div>
  );
}

function ViewSwitch({ store, films }: { store: Store; films: Films }) {
  const views = VIEWS.filter(([view]) => view !== "film" || store.film.value || films.newest.value);
  return (
    <div class="views" role="group" aria-label="View">
      {views.map(([view, title]) => (
        <button
          key={view}
          type="button"
          aria-pressed={store.stageView.value === view}
          onClick={() => {
            store.stageView.value = view;
          }}
        >
          {title}
        </button>
      ))}
    </div>
  );
}

function BrushSettings({ store }: { store: Store }) {
  const brush = store.brush.value;
  const labels = store.tool.value === "label";
  const { editor, marks = [] } = store.painted() ?? {};
  const smudging = store.tool.value === "smudge";
  const opacity = smudging ? "Strength" : "Opacity";
  const set = (change: Partial<typeof brush>) => {
    store.brush.value = { ...brush, ...change };
  };
  return (
    <div class="brush-settings">
      {!labels &&
        !smudging &&
        (editor === "marks" ? <MarkSwitch store={store} marks={marks} /> : <ColorField store={store} />)}
      <label>
        Size
        <input
          type="range"
          min={1}
          max={200}
          value={brush.size}
          aria-label="Brush size"
          onInput={(event) => set({ size: Number(event.currentTarget.value) })}
        />
        <output>{brush.size} px</output>
      </label>
      {!labels && (
        <label>
          {opacity}
          <input
            type="range"
            min={5}
            max={100}
            value={100 * brush.opacity}
            aria-label={`Brush ${opacity.toLowerCase()}`}
            onInput={(event) => set({ opacity: Number(event.currentTarget.value) / 100 })}
          />
          <output>{Math.round(100 * brush.opacity)} %</output>
        </label>
      )}
      {smudging && <span class="hint">Moves the paint of the layer that is chosen in the panel.</span>}
    </div>
  );
}

function ColorField({ store }: { store: Store }) {
  return (
    <label>
      Colour
      <input
        type="color"
        value={store.brush.value.color}
        onInput={(event) => {
          store.brush.value = { ...store.brush.value, color: event.currentTarget.value };
        }}
      />
    </label>
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
            store.tool.value = "brush";
          }}
        >
          {title}
        </button>
      ))}
    </div>
  );
}

function filmHint(store: Store, films: Films): string {
  if (films.newest.value) return "The newest finished frame of the film, which is being painted";
  return filmHas(store, store.frame.value)
    ? "The newest film"
    : "The newest film has no frame of this number: this is the video's";
}

const previewText = ({ final, scale }: Result): string =>
  `${final ? "Preview" : "A draft of this frame alone,"} at ${Math.round(100 * scale)} % of full size`;

/** What a view of paintings plays; empty while nothing is played. */
function playedText(store: Store, films: Films): string {
  if (!store.playing.value || !PAINTED_VIEWS.includes(store.stageView.value)) return "";
  const played = { preview: "previews", film: "the newest film" };
  const painting = films.painting();
  return painting ? `Playing ${played[painting.from]}` : "Playing the video: these frames are not painted";
}

/** Whether a preview is on its way, and at which scale the shown one is. */
function StageState({ store, films, onfull }: { store: Store; films: Films; onfull(): void }) {
  const result = store.results.value.get(store.frame.value);
  const film = store.stageView.value === "film" && store.tool.value === "pan";
  const scale =
    store.tool.value === "loupe"
      ? "The loupe shows the film at 100 % of full size"
      : film
        ? filmHint(store, films)
        : result && store.tool.value === "pan"
          ? previewText(result)
          : "";
  const text = store.problem.value || playedText(store, films) || store.busy.value || scale;
  const painting = PAINT_TOOLS.includes(store.tool.value);
  /** The film that is being painted; its progress changes too often to be read aloud. */
  const painted = film && films.newest.value && text === scale ? films.current.value?.job : null;
  const small = !painting && !film && text === scale && (result?.scale ?? 1) < 0.999;
  return (
    <>
      <p class={`stage-hint ${store.problem.value ? "wrong" : ""}`} role="status">
        {text}
        {painted && <span aria-hidden="true"> · {percent(painted.progress)}</span>}
      </p>
      {small && (
        <button type="button" class="button small" onClick={onfull}>
          Show at full size
        </button>
      )}
    </>
  );
}

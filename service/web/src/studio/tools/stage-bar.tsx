/** The bar above the stage: what it shows, the state of previews, and the settings of the brush. */

import { percent } from "../../ui/format";
import type { OnionSkin, PaintView } from "../drawing/settings";
import { type Films, filmHas } from "../films/films";
import { PAINT_TOOLS, PAINTED_VIEWS, type Result, SELECT_TOOLS, type StageView, type Store } from "../state/store";
import { BrushBar } from "./brush-bar";

const VIEWS: [StageView, string][] = [
  ["source", "Original"],
  ["compare", "Compare"],
  ["overlay", "Overlay"],
  ["painted", "Painted"],
  ["flicker", "Flicker"],
  ["film", "Film"],
];

const PAINT_VIEWS: [PaintView, string][] = [
  ["key", "Painting"],
  ["compare", "Compare"],
  ["overlay", "Overlay"],
  ["source", "Original"],
];

const ONION: [OnionSkin["show"], string][] = [
  ["none", "off"],
  ["painted", "painted"],
  ["source", "original"],
];

/** The bar above the stage: the view, and below it the settings of the brush while the user paints. */
export function StageBar({ store, films, onfull }: { store: Store; films: Films; onfull(): void }) {
  const painting = PAINT_TOOLS.includes(store.tool.value);
  const brush = painting && !SELECT_TOOLS.includes(store.tool.value);
  const matte = store.tool.value === "matteBrush" || store.tool.value === "matteEraser";
  return (
    <div class="stage-bar">
      {painting ? <PaintViewSwitch store={store} /> : <ViewSwitch store={store} films={films} />}
      <StageState store={store} films={films} onfull={onfull} />
      {(brush || matte || store.tool.value === "label") && <BrushBar store={store} />}
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

/** What the stage shows of the key, and whether the neighbours shine through it. */
function PaintViewSwitch({ store }: { store: Store }) {
  const { view, onion, panel } = store.drawing;
  const { show, frames } = onion.value;
  return (
    <>
      <div class="views" role="group" aria-label="View while painting">
        {PAINT_VIEWS.map(([name, title]) => (
          <button
            key={name}
            type="button"
            aria-pressed={view.value === name}
            onClick={() => {
              view.value = name;
            }}
          >
            {title}
          </button>
        ))}
      </div>
      <label class="onion-field">
        Onion skin
        <select
          value={show}
          onChange={(event) => {
            onion.value = { ...onion.value, show: event.currentTarget.value as typeof show };
          }}
        >
          {ONION.map(([name, title]) => (
            <option key={name} value={name}>
              {title}
            </option>
          ))}
        </select>
        {show !== "none" && (
          <select
            aria-label="Frames on each side"
            value={frames}
            onChange={(event) => {
              onion.value = { ...onion.value, frames: Number(event.currentTarget.value) };
            }}
          >
            {[1, 2, 3].map((count) => (
              <option key={count} value={count}>
                ± {count}
              </option>
            ))}
          </select>
        )}
      </label>
      <button
        type="button"
        class="button small quiet reference-button"
        aria-expanded={panel.value === "reference"}
        onClick={() => {
          panel.value = panel.value === "reference" ? "" : "reference";
        }}
      >
        Reference
      </button>
    </>
  );
}

function filmHint(store: Store, films: Films): string {
  if (films.newest.value) return "The newest finished frame of the film, which is being painted";
  return filmHas(store, store.frame.value)
    ? films.present
      ? "The film"
      : "The newest film"
    : "The newest film has no frame of this number: this is the video's";
}

const previewText = ({ final, scale }: Result): string =>
  `${final ? "Preview" : "A draft of this frame alone,"} at ${Math.round(100 * scale)} % of full size`;

/** What a view of paintings plays; empty while nothing is played. */
function playedText(store: Store, films: Films): string {
  if (!store.playing.value || !PAINTED_VIEWS.includes(store.stageView.value)) return "";
  const played = { preview: "previews", film: films.present ? "the film" : "the newest film" };
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

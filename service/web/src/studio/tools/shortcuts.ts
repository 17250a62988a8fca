/** Keyboard shortcuts of the studio. They do nothing while the user types in a field. */

import { effect, signal } from "@preact/signals";
import { notify } from "../../ui/notices";
import type { FilmPlayer } from "../films/film-player";
import { cutsWithin } from "../films/filmstrip";
import { toggleMarker } from "../films/markers";
import { looping, type Playback } from "../films/playback";
import type { SelectTool } from "../keys/select-tool";
import type { Stage } from "../stage/stage";
import { chordOf, commandOf } from "../state/key-bindings";
import { SELECT_TOOLS, type Store, type Tool } from "../state/store";
import { nextKey, previousKey } from "../state/timeline";
import { TURN_DEGREES, toggleAlone } from "./toolbar";

const HIDDEN = "impasto.panel-hidden";
/** Whether the list of shortcuts is open. */
export const listOpen = signal(false);
/** Whether the stage has the room of the panel; kept in this browser. */
export const panelHidden = signal(localStorage.getItem(HIDDEN) === "yes");
effect(() => localStorage.setItem(HIDDEN, panelHidden.value ? "yes" : ""));

export interface ShortcutParts {
  store: Store;
  stage: () => Stage | null;
  playback: Playback;
  /** The film over the stage. */
  player: FilmPlayer;
  /** Play all shots, or stop. */
  playFilm(): void;
  select: SelectTool;
  /** Paint the film. */
  paint(): void;
  /** Tools that the present method has. */
  tools: () => readonly Tool[];
}

/** Install the shortcuts; returns what removes them. */
export function installShortcuts({
  store,
  stage,
  playback,
  player,
  playFilm,
  select,
  paint,
  tools,
}: ShortcutParts): () => void {
  const step = (by: number) => {
    playback.stop();
    store.goTo(store.frame.value + by);
  };

  /** To the next cut within the shot, else to the shot beside it. */
  const cut = (find: typeof nextKey, by: number) => {
    playback.stop();
    const frame = find([store.reach.value[0], ...cutsWithin(store)], store.frame.value);
    if (frame === undefined) store.session.step(by);
    else store.goTo(frame);
  };

  const actions: Record<string, () => void> = {
    previous: () => step(-1),
    next: () => step(1),
    back10: () => step(-10),
    on10: () => step(10),
    first: () => step(-store.frames),
    last: () => step(store.frames),
    backwards: () => playback.shuttle("j"),
    stop: () => playback.shuttle("k"),
    forwards: () => playback.shuttle("l"),
    play: () => (player.playing.peek() ? playFilm() : playback.toggle()),
    film: () => playFilm(),
    previousCut: () => cut(previousKey, -1),
    nextCut: () => cut(nextKey, 1),
    loop: () => {
      looping.value = !looping.value;
    },
    marker: () => toggleMarker(store),
    panel: () => {
      panelHidden.value = !panelHidden.value;
    },
    list: () => {
      listOpen.value = true;
    },
    trim: () => {
      store.trimming.value = !store.trimming.value;
    },
    zoomIn: () => stage()?.zoom(1.25),
    zoomOut: () => stage()?.zoom(0.8),
    fit: () => stage()?.fit(),
    smaller: () => store.resizeBrush(Math.min(store.brush.value.size - 1, store.brush.value.size / 1.25)),
    larger: () => store.resizeBrush(Math.max(store.brush.value.size + 1, store.brush.value.size * 1.25)),
    swap: () => store.swapColours(),
    mirror: () => stage()?.mirror(),
    turnLeft: () => stage()?.turn(-TURN_DEGREES),
    turnRight: () => stage()?.turn(TURN_DEGREES),
    alone: () => toggleAlone(store),
    undo: () => store.session.undo(),
    redo: () => store.session.redo(),
    paint: () => paint(),
  };

  function onkey(event: KeyboardEvent): void {
    const target = event.target as Element;
    const typing = target.closest(
      "input:not([type=range], [type=checkbox], [type=radio], [type=color]), textarea, select, dialog",
    );
    if (typing) return;
    if (event.key === "Escape") {
      player.stop();
      if (store.drawing.alone.value) toggleAlone(store);
    }
    if (SELECT_TOOLS.includes(store.tool.value) && !ownKey(target, event) && selectKeys(event)) {
      event.preventDefault();
      return;
    }
    const command =
      commandOf(chordOf(event)) ?? (event.key.toLowerCase() === "y" && event.ctrlKey ? "redo" : undefined);
    if (!command || ownKey(target, event)) return;
    if (player.open.peek() && !["play", "film", "loop", "list"].includes(command)) player.stop();
    const action = actions[command];
    if (action) action();
    else if (tools().includes(command as Tool)) store.tool.value = command as Tool;
    else return;
    event.preventDefault();
  }

  /** Whether the focused control uses the key itself. */
  function ownKey(target: Element, { key, shiftKey }: KeyboardEvent): boolean {
    if (key === " ") return !shiftKey && target.closest("button, summary, a") !== null;
    const moved = target.closest("input[type=range], [role=slider], [role=radiogroup], [role=tablist]");
    return moved !== null && key.startsWith("Arrow");
  }

  /** Keys of the tools that select and move; false if it is none of them. */
  function selectKeys({ key, altKey, ctrlKey, metaKey, shiftKey }: KeyboardEvent): boolean {
    if (altKey || ctrlKey || metaKey) return false;
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[key];
    if (key === "Escape") select.clear();
    else if (key === "Delete" || key === "Backspace") return select.erase();
    else if (way && store.tool.value === "transform") {
      const step = shiftKey ? 10 : 1;
      select.nudge(step * (way[0] ?? 0), step * (way[1] ?? 0));
    } else return false;
    return true;
  }

  const listener = (event: KeyboardEvent) => {
    try {
      onkey(event);
    } catch (error) {
      notify(error);
    }
  };
  /** Escape leaves the full screen of the browser without a key event. */
  const left = () => {
    if (!document.fullscreenElement) store.drawing.alone.value = false;
  };
  document.addEventListener("keydown", listener);
  document.addEventListener("fullscreenchange", left);
  return () => {
    document.removeEventListener("keydown", listener);
    document.removeEventListener("fullscreenchange", left);
  };
}

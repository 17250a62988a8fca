/** Keyboard shortcuts of the studio. They do nothing while the user types in a field. */

import { notify } from "../../ui/notices";
import type { Playback } from "../films/playback";
import type { Stage } from "../stage/stage";
import type { Store, Tool } from "../state/store";
import { nextKey, previousKey, shotStarts } from "../state/timeline";

const TOOL_KEYS: Record<string, Tool> = {
  v: "pan",
  b: "brush",
  e: "eraser",
  s: "smudge",
  g: "fill",
  i: "picker",
  r: "region",
  d: "direction",
  z: "loupe",
};

export interface ShortcutParts {
  store: Store;
  stage: () => Stage | null;
  playback: Playback;
  /** Tools that the present method has. */
  tools: () => readonly Tool[];
}

/** Install the shortcuts; returns what removes them. */
export function installShortcuts({ store, stage, playback, tools }: ShortcutParts): () => void {
  const step = (by: number) => {
    playback.stop();
    store.goTo(store.frame.value + by);
  };

  const goTo = (frame: number | undefined) => {
    playback.stop();
    if (frame !== undefined) store.goTo(frame);
  };

  const actions: Record<string, (event: KeyboardEvent) => void> = {
    ArrowLeft: (event) => step(event.shiftKey ? -10 : -1),
    ArrowRight: (event) => step(event.shiftKey ? 10 : 1),
    Home: () => step(-store.frames),
    End: () => step(store.frames),
    j: () => playback.shuttle("j"),
    k: () => playback.shuttle("k"),
    l: () => playback.shuttle("l"),
    " ": () => playback.toggle(),
    ",": () => goTo(previousKey(shotStarts(store.cuts.value), store.frame.value)),
    ".": () => goTo(nextKey(shotStarts(store.cuts.value), store.frame.value)),
    "+": () => stage()?.zoom(1.25),
    "-": () => stage()?.zoom(0.8),
    "0": () => stage()?.fit(),
    "[": () => resize(1 / 1.25),
    "]": () => resize(1.25),
  };

  function resize(factor: number): void {
    const { size, ...brush } = store.brush.value;
    store.brush.value = { ...brush, size: Math.min(400, Math.max(1, Math.round(size * factor))) };
  }

  function onkey(event: KeyboardEvent): void {
    const target = event.target as Element;
    const typing = target.closest(
      "input:not([type=range], [type=checkbox], [type=radio], [type=color]), textarea, select, dialog",
    );
    if (typing) return;
    if (event.ctrlKey || event.metaKey) {
      undoKeys(event);
      return;
    }
    if (event.altKey || (event.key === " " && target.closest("button, summary, a"))) return;
    if (
      target.closest("input[type=range], [role=slider], [role=radiogroup], [role=tablist]") &&
      event.key.startsWith("Arrow")
    )
      return;
    const tool = TOOL_KEYS[event.key];
    const action = actions[event.key];
    if (tool && tools().includes(tool)) store.tool.value = tool;
    else if (action) action(event);
    else return;
    event.preventDefault();
  }

  function undoKeys(event: KeyboardEvent): void {
    const key = event.key.toLowerCase();
    if (key === "z" && event.shiftKey) store.redo();
    else if (key === "z") store.undo();
    else if (key === "y") store.redo();
    else return;
    event.preventDefault();
  }

  const listener = (event: KeyboardEvent) => {
    try {
      onkey(event);
    } catch (error) {
      notify(error);
    }
  };
  document.addEventListener("keydown", listener);
  return () => document.removeEventListener("keydown", listener);
}

/** Which key does what in the studio: the usual keys, and those that the user has chosen, which this browser keeps. */

import { computed, signal } from "@preact/signals";

const STORED = "impasto.keys";

export interface Command {
  id: string;
  group: string;
  text: string;
  /** Its usual key: "b", "Shift+ArrowLeft", "Ctrl+z"; "Ctrl" is the command key, too. */
  key: string;
}

const group = (title: string, rows: [id: string, key: string, text: string][]): Command[] =>
  rows.map(([id, key, text]) => ({ id, group: title, text, key }));

export const COMMANDS: readonly Command[] = [
  ...group("Play", [
    ["play", "Space", "Play or pause"],
    ["film", "Shift+Space", "Play all shots"],
    ["backwards", "j", "Play backwards; again: faster"],
    ["stop", "k", "Stop"],
    ["forwards", "l", "Play forwards; again: faster"],
    ["loop", "o", "Play again and again"],
    ["previous", "ArrowLeft", "Previous frame"],
    ["next", "ArrowRight", "Next frame"],
    ["back10", "Shift+ArrowLeft", "Ten frames back"],
    ["on10", "Shift+ArrowRight", "Ten frames on"],
    ["first", "Home", "First frame of the shot"],
    ["last", "End", "Last frame of the shot"],
    ["previousCut", ",", "Previous cut, or shot"],
    ["nextCut", ".", "Next cut, or shot"],
  ]),
  ...group("Shots", [
    ["trim", "t", "Move the in and out points"],
    ["marker", "m", "A marker at this frame, or none"],
  ]),
  ...group("Paint", [
    ["pan", "v", "Move the view"],
    ["brush", "b", "Brush"],
    ["eraser", "e", "Eraser"],
    ["smudge", "s", "Smudge"],
    ["fill", "g", "Fill"],
    ["picker", "i", "Pick a colour"],
    ["object", "n", "Mark an object"],
    ["matte", "u", "Mark the layer's matte"],
    ["matteBrush", "y", "Add to the matte with a brush"],
    ["matteEraser", "Shift+y", "Erase the matte"],
    ["rectangle", "a", "Select a rectangle"],
    ["outline", "q", "Select with an outline"],
    ["transform", "w", "Move, scale, turn"],
    ["smaller", "[", "Smaller brush"],
    ["larger", "]", "Larger brush"],
    ["swap", "x", "Swap the two colours"],
    ["turnLeft", "4", "Turn the view to the left"],
    ["turnRight", "6", "Turn the view to the right"],
    ["mirror", "h", "Mirror the view"],
    ["alone", "f", "Draw in the whole window"],
    ["region", "r", "Pick regions"],
    ["correct", "c", "Correct the region"],
    ["direction", "d", "Direct the strokes"],
    ["loupe", "z", "Loupe at full size"],
    ["zoomIn", "+", "Zoom in"],
    ["zoomOut", "-", "Zoom out"],
    ["fit", "0", "Show the whole frame"],
  ]),
  ...group("Project", [
    ["undo", "Ctrl+z", "Undo"],
    ["redo", "Ctrl+Shift+z", "Redo"],
    ["paint", "Ctrl+Enter", "Paint the film"],
    ["panel", "p", "Hide or show the panel"],
    ["list", "?", "This list"],
  ]),
];

/** Keys that move the focus, close and confirm everywhere. */
const RESERVED = ["Tab", "Shift+Tab", "Escape", "Enter"];

/** The key that was pressed, as `Command.key` has it; empty while only Shift, Ctrl or Alt are down. */
export function chordOf(event: Pick<KeyboardEvent, "key" | "shiftKey" | "ctrlKey" | "metaKey" | "altKey">): string {
  const { key } = event;
  if (["Shift", "Control", "Meta", "Alt", "AltGraph", "Dead"].includes(key)) return "";
  const letter = key.length === 1 && key.toLowerCase() !== key.toUpperCase();
  const named = key === " " ? "Space" : letter ? key.toLowerCase() : key;
  const command = event.ctrlKey || event.metaKey;
  const shift = event.shiftKey && (letter || key === " " || key.length > 1);
  return `${command ? "Ctrl+" : ""}${event.altKey ? "Alt+" : ""}${shift ? "Shift+" : ""}${named}`;
}

/** "Ctrl+Shift+z" as on the keys: "Ctrl+Shift+Z". */
export function chordText(chord: string): string {
  const names: Record<string, string> = { ArrowLeft: "Left", ArrowRight: "Right", ArrowUp: "Up", ArrowDown: "Down" };
  const parts = /^(.*\+)?(.+)$/.exec(chord);
  const [before = "", key = ""] = parts ? [parts[1] ?? "", parts[2]] : ["", chord];
  return before + (names[key] ?? (key.length === 1 ? key.toUpperCase() : key));
}

/** Chosen keys by command; empty: none. Only those that differ from the usual ones. */
export type Chosen = Readonly<Record<string, string>>;

function stored(): Chosen {
  try {
    const found: unknown = JSON.parse(localStorage.getItem(STORED) ?? "{}");
    const known = COMMANDS.map(({ id }) => id);
    const entries = Object.entries(found as object).filter(
      ([id, key]) => known.includes(id) && typeof key === "string",
    );
    return Object.fromEntries(entries);
  } catch {
    return {};
  }
}

export const chosen = signal<Chosen>(stored());

function choose(next: Chosen): void {
  chosen.value = next;
  localStorage.setItem(STORED, JSON.stringify(next));
}

export const keyOf = ({ id, key }: Command, of: Chosen = chosen.value): string => of[id] ?? key;

/** A chosen key is that of its command, also if a later version has another command with that key. */
const commands = computed(() => {
  const isChosen = ({ id }: Command) => Number(id in chosen.value);
  const rows = [...COMMANDS].sort((one, other) => isChosen(one) - isChosen(other));
  return new Map(rows.map((command) => [keyOf(command), command.id]));
});

/** The command of a key; undefined: none. */
export const commandOf = (chord: string): string | undefined => (chord ? commands.value.get(chord) : undefined);

/** The present key of a command, as it is shown; empty: it has none. */
export const keyText = (id: string): string => {
  const command = COMMANDS.find((one) => one.id === id);
  return command ? chordText(keyOf(command)) : "";
};

/** Why a key cannot be a command's; null: it can. `taken`: the command that has it now. */
export function conflict(id: string, chord: string, of: Chosen = chosen.value): { taken?: Command } | null {
  if (RESERVED.includes(chord)) return {};
  const taken = COMMANDS.find((one) => one.id !== id && keyOf(one, of) === chord);
  return taken ? { taken } : null;
}

/** The chosen keys after a command gets a key: the command that had it has none then. */
export function withKey(id: string, chord: string, of: Chosen): Chosen {
  const next: Record<string, string> = { ...of, [id]: chord };
  for (const other of COMMANDS) if (chord && other.id !== id && keyOf(other, of) === chord) next[other.id] = "";
  const own = (one: string) => COMMANDS.find((command) => command.id === one)?.key;
  return Object.fromEntries(Object.entries(next).filter(([one, key]) => key !== own(one)));
}

/** Give a command a key; empty: none. */
export const setKey = (id: string, chord: string): void => choose(withKey(id, chord, chosen.peek()));

/** Give every command its usual key. */
export const resetKeys = (): void => choose({});

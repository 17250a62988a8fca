/** The list of the studio's keys, opened by "?" or a button, in which each key can be changed. */

import { useEffect, useRef, useState } from "preact/hooks";
import { announce } from "../../ui/notices";
import {
  COMMANDS,
  type Command,
  chordOf,
  chordText,
  chosen,
  conflict,
  keyOf,
  resetKeys,
  setKey,
} from "../state/key-bindings";
import { listOpen } from "./shortcuts";

/** Keys that belong to a part of the page that has the focus, and keys that are held. */
const FIXED: [string, string][] = [
  ["Left Right", "On the shots: choose a shot; with Shift move it"],
  ["Delete", "On the shots: remove the shot"],
  ["+ -", "On the filmstrip: show fewer or more frames"],
  ["Ctrl+drag", "With a brush: its size"],
  ["Shift", "With a brush: a straight line from the last stroke's end"],
  ["Alt", "With a brush: pick a colour"],
];

export function ShortcutList() {
  const dialog = useRef<HTMLDialogElement>(null);
  const open = listOpen.value;
  useEffect(() => {
    if (open && !dialog.current?.open) dialog.current?.showModal();
  }, [open]);
  const closed = () => {
    listOpen.value = false;
  };
  const groups = [...new Set(COMMANDS.map(({ group }) => group))];
  return (
    <dialog ref={dialog} class="project-menu shortcuts" aria-labelledby="shortcuts-title" onClose={closed}>
      <h2 id="shortcuts-title">Keys of the studio</h2>
      <p class="hint">Select a key to change it. This browser keeps your keys.</p>
      {open && (
        <div class="shortcut-groups">
          {groups.map((title) => (
            <section key={title}>
              <h3>{title}</h3>
              <ul>
                {COMMANDS.filter(({ group }) => group === title).map((command) => (
                  <Row key={command.id} command={command} />
                ))}
              </ul>
            </section>
          ))}
          <section>
            <h3>Where the focus is</h3>
            <ul>
              {FIXED.map(([keys, text]) => (
                <li key={text}>
                  <kbd>{keys}</kbd>
                  <span>{text}</span>
                </li>
              ))}
            </ul>
          </section>
        </div>
      )}
      <form method="dialog" class="actions">
        <button
          type="button"
          class="button"
          disabled={!Object.keys(chosen.value).length}
          onClick={() => {
            resetKeys();
            announce("All keys are the usual ones again.");
          }}
        >
          Use the usual keys
        </button>
        <button type="submit" class="button primary">
          Close
        </button>
      </form>
    </dialog>
  );
}

/** A command with its key: select it, then press another one. */
function Row({ command }: { command: Command }) {
  const [waiting, setWaiting] = useState(false);
  const [wished, setWished] = useState("");
  const taken = wished ? conflict(command.id, wished) : null;
  const key = keyOf(command);
  const set = (chord: string) => {
    setKey(command.id, chord);
    setWished("");
    announce(chord ? `${command.text}: ${chordText(chord)}` : `${command.text} has no key.`);
  };
  const onKey = (event: KeyboardEvent) => {
    if (!waiting || event.key === "Tab") return;
    event.preventDefault();
    event.stopPropagation();
    const chord = chordOf(event);
    if (!chord) return;
    setWaiting(false);
    if (chord === "Escape") return;
    if (chord === "Backspace" || chord === "Delete") set("");
    else if (conflict(command.id, chord)) setWished(chord);
    else set(chord);
  };
  return (
    <li>
      <button
        type="button"
        class="key-button"
        aria-label={`${command.text}: ${key ? chordText(key) : "no key"}. Change it`}
        data-changed={command.id in chosen.value}
        onClick={() => setWaiting(!waiting)}
        onBlur={() => setWaiting(false)}
        onKeyDown={onKey}
      >
        <kbd>{waiting ? "Press a key" : key ? chordText(key) : "none"}</kbd>
      </button>
      <span>{command.text}</span>
      {waiting && <small role="status">Delete takes the key away, Escape leaves it.</small>}
      {taken && (
        <p role="alert">
          {taken.taken
            ? `${chordText(wished)} is the key of “${taken.taken.text}”.`
            : `${chordText(wished)} has its own use everywhere.`}{" "}
          {taken.taken && (
            <button type="button" class="button small" onClick={() => set(wished)}>
              Use it here
            </button>
          )}
          <button type="button" class="button small" onClick={() => setWished("")}>
            Leave it
          </button>
        </p>
      )}
    </li>
  );
}

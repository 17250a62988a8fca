/** Dialogs that ask the user, and buttons that act on the service: at once, or after such a dialog. */

import { render, type VNode } from "preact";
import { useState } from "preact/hooks";
import { notify } from "./notices";

/** Show a modal dialog until its form calls `answer`; resolves to the answer. `onclose`: Escape, before the answer. */
function modal<Answer>(
  style: string,
  form: (answer: (value: Answer) => void) => VNode,
  onclose: (answer: (value: Answer) => void, dialog: HTMLDialogElement) => void,
): Promise<Answer> {
  return new Promise((resolve) => {
    const host = document.createElement("div");
    const answer = (value: Answer) => {
      render(null, host);
      host.remove();
      resolve(value);
    };
    document.body.append(host);
    const open = (dialog: HTMLDialogElement | null) => {
      if (dialog && !dialog.open) dialog.showModal();
    };
    render(
      <dialog ref={open} class={style} onClose={(event) => onclose(answer, event.currentTarget)}>
        {form(answer)}
      </dialog>,
      host,
    );
  });
}

/**
 * Ask for an API key until one is given, or let the user sign in. `refused`: one was sent, and the service did not
 * accept it.
 */
export function askKey(refused: boolean, signIn: string): Promise<string> {
  return modal<string>(
    "key",
    (answer) => (
      <form
        method="dialog"
        onSubmit={(event) => {
          event.preventDefault();
          answer(String(new FormData(event.currentTarget).get("key")).trim());
        }}
      >
        <h2>{signIn ? "Sign in" : "API key needed"}</h2>
        {signIn && (
          <a class="button primary" href={signIn}>
            Sign in
          </a>
        )}
        <p>
          {signIn ? "Or give an API key." : "This service accepts requests with an API key only."} The key is kept for
          this tab and forgotten when you close it.
        </p>
        <label for="api-key">API key</label>
        <input type="password" id="api-key" name="key" autocomplete="off" required spellcheck={false} />
        {refused && <p class="field-error">The service refused that key. Check it and try again.</p>}
        <button class={`button ${signIn ? "" : "primary"}`} type="submit">
          Continue
        </button>
      </form>
    ),
    (_answer, dialog) => dialog.showModal(),
  );
}

export interface Confirmation {
  title: string;
  text: string;
  /** Ask for a reason, for other operators to read. */
  why?: boolean;
}

/** The reason (perhaps empty), or null if the user decided against it. */
function confirm({ title, text, why, verb, danger }: Confirmation & { verb: string; danger: boolean }) {
  return modal<string | null>(
    "key confirm-dialog",
    (answer) => (
      <form
        method="dialog"
        onSubmit={(event) => {
          event.preventDefault();
          answer(String(new FormData(event.currentTarget).get("why") ?? "").trim());
        }}
      >
        <h2>{title}</h2>
        <p>{text}</p>
        {why && <label for="why">Why (for the other operators)</label>}
        {why && <input type="text" id="why" name="why" maxLength={300} autocomplete="off" />}
        <div class="actions">
          <button class={`button ${danger ? "danger" : "primary"}`} type="submit">
            {verb}
          </button>
          <button class="button" type="button" onClick={() => answer(null)}>
            Leave it
          </button>
        </div>
      </form>
    ),
    (answer) => answer(null),
  );
}

export interface Choices<Value extends string> {
  title: string;
  text: string;
  /** Value, title, and what it does. */
  choices: readonly (readonly [Value, string, string])[];
}

/** One of several values; null if the user decided against all. */
export function askChoice<Value extends string>({ title, text, choices }: Choices<Value>): Promise<Value | null> {
  return modal<Value | null>(
    "key confirm-dialog",
    (answer) => (
      <form method="dialog" onSubmit={(event) => event.preventDefault()}>
        <h2>{title}</h2>
        <p>{text}</p>
        <ul class="choices">
          {choices.map(([value, name, hint]) => (
            <li key={value}>
              <button class="button" type="button" onClick={() => answer(value)}>
                {name}
              </button>
              <span class="hint">{hint}</span>
            </li>
          ))}
        </ul>
        <div class="actions">
          <button class="button" type="button" onClick={() => answer(null)}>
            Leave it
          </button>
        </div>
      </form>
    ),
    (answer) => answer(null),
  );
}

export interface ActionButtonProps {
  label: string;
  title?: string;
  danger?: boolean;
  /** Asked first; without it the button acts at once, since nothing is lost. */
  confirmation?: Confirmation;
  /** May throw a Problem, which is shown. `reason`: what the user wrote, perhaps empty. */
  act(reason: string): unknown;
  /** Called after the action, whether it succeeded or not. */
  done?(): void;
}

/** A small button that acts on the service. */
export function ActionButton({ label, title, danger = false, confirmation, act, done }: ActionButtonProps) {
  const [busy, setBusy] = useState(false);
  const onClick = async () => {
    const reason = confirmation ? await confirm({ ...confirmation, verb: label, danger }) : "";
    if (reason === null) return;
    setBusy(true);
    await Promise.resolve(act(reason)).catch(notify);
    setBusy(false);
    done?.();
  };
  return (
    <button
      type="button"
      class={`button small ${danger ? "danger" : ""}`}
      title={title}
      disabled={busy}
      onClick={onClick}
    >
      {label}
    </button>
  );
}

/** Short messages at the edge of the page, for what belongs to no field, and blocks with a fault or warnings. */

import { signal } from "@preact/signals";
import { type ComponentChildren, render, toChildArray } from "preact";
import { asProblem, isAbort } from "../api/api";
import { byId } from "./dom";
import { Icon, IconButton } from "./icons";

const SHOWN_MS = 12_000;
const ANNOUNCED_MS = 4000;

/** What a message shows; a Problem is one. */
export interface Message {
  title?: string;
  message: string;
  remedy?: string;
}

interface Notice extends Message {
  id: number;
  /** Read out only. */
  spoken?: boolean;
  undo?: () => void;
  close(): void;
}

const notices = signal<Notice[]>([]);
let count = 0;

function add(notice: Omit<Notice, "id" | "close">, ms: number, onclose = () => {}): void {
  if (!count) render(<Notices />, byId("notices"));
  const id = ++count;
  const leave = (act: () => void) => () => {
    if (!notices.peek().some((each) => each.id === id)) return;
    clearTimeout(timer);
    notices.value = notices.peek().filter((each) => each.id !== id);
    act();
  };
  const close = leave(onclose);
  const timer = setTimeout(close, ms);
  if (notice.undo) window.addEventListener("pagehide", close, { once: true });
  notices.value = [...notices.peek(), { ...notice, id, close, ...(notice.undo && { undo: leave(notice.undo) }) }];
}

/** Show a Problem, or any error, until it is closed or twelve seconds have passed. */
export function notify(error: unknown): void {
  if (!isAbort(error)) notifyOf(asProblem(error));
}

/** Show a message in the same place. */
export const notifyOf = ({ title = "", message, remedy = "" }: Message): void =>
  add({ title, message, remedy }, SHOWN_MS);

/** A message with an action, for example "Deleted" with "Undo"; `timeout()` is called when it leaves without the action. */
export const offerUndo = (message: string, undo: () => void, timeout: () => void, ms = 6000): void =>
  add({ message, undo }, ms, timeout);

/** Speak to assistive technology only. */
export const announce = (text: string): void => add({ message: text, spoken: true }, ANNOUNCED_MS);

function Notices() {
  return notices.value.map(({ id, title, message, remedy, spoken, undo, close }) =>
    spoken ? (
      <p key={id} class="visually-hidden">
        {message}
      </p>
    ) : (
      <div key={id} class={`notice ${undo ? "plain" : ""}`}>
        {!undo && <Icon name="alert" />}
        <div>
          {title && <strong>{title}</strong>}
          <p>{message}</p>
          {remedy && <p class="remedy">{remedy}</p>}
        </div>
        {undo && (
          <button type="button" class="button small" onClick={undo}>
            Undo
          </button>
        )}
        <IconButton name="close" label="Close" onClick={close} />
      </div>
    ),
  );
}

/** A Problem as a block in the page, with the actions that may help. */
export function ProblemBlock({ error, children }: { error: Message; children?: ComponentChildren }) {
  return (
    <div class="problem" role="alert">
      <Icon name="alert" />
      <div>
        <strong>{error.title || "That did not work"}</strong>
        <p>{error.message}</p>
        {error.remedy && <p class="remedy">{error.remedy}</p>}
        {toChildArray(children).length > 0 && <div class="actions">{children}</div>}
      </div>
    </div>
  );
}

/** A block with warnings that the user should know although the work continues. */
export function WarningBlock({ title, messages }: { title: string; messages: string[] }) {
  if (!messages.length) return null;
  return (
    <div class="problem warning" role="status">
      <Icon name="alert" />
      <div>
        <strong>{title}</strong>
        {messages.map((message) => (
          <p key={message}>{message}</p>
        ))}
      </div>
    </div>
  );
}

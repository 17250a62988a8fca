/** The finished film in other formats: converted by the service on demand, then saved. */

import * as api from "../shared/api";
import { h } from "../shared/dom";
import { percent } from "../shared/format";
import { outputOf, outputs } from "../shared/formats";
import { announce, notify } from "../shared/notices";
import type { Job, OutputName, View } from "../shared/types";

const POLL_MS = 700;

/** Names of formats that a film can be exported in, besides its own: none for a coarse one. */
export const exportsOf = (own: OutputName | undefined): OutputName[] =>
  outputOf(own).lossy ? [] : outputs.map(({ name }) => name).filter((name) => name !== outputOf(own).name);

/** Buttons for the other formats; no element where there are none. */
export function createExports(job: Job): View | null {
  const offered = exportsOf(job.request.output?.format);
  if (!offered.length) return null;
  const controller = new AbortController();
  const buttons = outputs
    .filter(({ name }) => offered.includes(name))
    .map(({ name, title, help }) => {
      const button = h("button", { type: "button", class: "button small", title: help }, title);
      button.addEventListener("click", () => save(job, name, title, button, controller.signal).catch(notify));
      return button;
    });
  const element = h(
    "div",
    { class: "exports", role: "group", "aria-label": "Export as" },
    h("span", {}, "Export as"),
    buttons,
  );
  return { element, close: () => controller.abort() };
}

async function save(
  job: Job,
  format: OutputName,
  title: string,
  button: HTMLButtonElement,
  signal: AbortSignal,
): Promise<void> {
  button.disabled = true;
  try {
    const made = await converted(job, format, signal, (done) => {
      button.textContent = `${title}, ${percent(done)}`;
    });
    announce(`${title} is ready.`);
    await api.download(api.paths.result(made.id));
  } finally {
    button.disabled = false;
    button.textContent = title;
  }
}

/** The finished export. Throws a Problem if it fails. */
async function converted(
  job: Job,
  format: OutputName,
  signal: AbortSignal,
  progress: (done: number) => void,
): Promise<Job> {
  const answer = await api.post(api.url`/v1/jobs/${job.id}/exports`, { format }, { signal });
  let made: Job = await answer.json();
  while (!["succeeded", "failed", "cancelled"].includes(made.state)) {
    progress(made.progress);
    await new Promise((done) => setTimeout(done, POLL_MS));
    made = await api.job(made.id, signal);
  }
  if (made.state === "succeeded") return made;
  const { message = "The export was cancelled.", remedy = "Try it again." } = made.error ?? {};
  throw new api.Problem({ title: "Not exported", detail: message, remedy });
}

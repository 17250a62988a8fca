/** The jobs that are selected in the list, and the buttons that act on all of them. */

import type { Job } from "../api/schemas";
import { confirmButton, plainButton } from "../ui/confirm";
import { h } from "../ui/dom";
import { notifyOf } from "../ui/notices";
import { type BulkAction, bulk } from "./api";

export interface Selection {
  /** How many jobs are selected, and the buttons. Hidden while none is. */
  element: HTMLElement;
  /** The checkbox of a job. */
  target(job: Job): HTMLElement;
  /** The jobs that are listed now: others are no longer selected. */
  listed(jobs: Job[]): void;
}

export function createSelection(again: () => void): Selection {
  const selected = new Set<string>();
  const boxes = new Map<string, HTMLInputElement>();
  const count = h("span", { role: "status" });
  const element = h("div", { class: "selection", role: "group", "aria-label": "Selected jobs" }, count);
  element.hidden = true;

  function show(): void {
    element.hidden = selected.size === 0;
    count.textContent = selected.size === 1 ? "1 job selected" : `${selected.size} jobs selected`;
  }

  function choose(id: string, chosen: boolean): void {
    if (chosen) selected.add(id);
    else selected.delete(id);
    const box = boxes.get(id);
    if (box) box.checked = chosen;
    show();
  }

  async function act(action: BulkAction): Promise<void> {
    const { items } = await bulk(action, [...selected]);
    for (const item of items) if (!item.error) choose(item.job_id, false);
    const refused = items.filter((item) => item.error);
    if (refused.length)
      notifyOf({
        message: `${refused.length} of ${items.length} jobs: ${[...new Set(refused.map(reason))].join(" ")}`,
      });
  }

  const ask = (label: string, action: BulkAction, text: string) =>
    confirmButton({
      label,
      title: `${label} the selected jobs?`,
      text,
      danger: true,
      act: () => act(action),
      done: again,
    });
  element.append(
    ask("Cancel", "cancel", "They stop within a second. Finished tasks are kept, so that the jobs can be retried."),
    plainButton({ label: "Retry", act: () => act("retry"), done: again }),
    ask("Delete", "delete", "The jobs that have ended are deleted with their files. Others stay; cancel them first."),
    plainButton({ label: "Select all", act: () => [...boxes.keys()].map((id) => choose(id, true)), done: () => {} }),
    plainButton({ label: "Select none", act: () => [...selected].map((id) => choose(id, false)), done: () => {} }),
  );
  return {
    element,
    target(job) {
      const name = `Select ${job.request.name || job.request.method}`;
      const box = h("input", { type: "checkbox", class: "select-job", "aria-label": name });
      box.checked = selected.has(job.id);
      box.addEventListener("change", () => choose(job.id, box.checked));
      boxes.set(job.id, box);
      return h("label", { class: "select-target" }, box);
    },
    listed(jobs) {
      const ids = new Set(jobs.map((job) => job.id));
      for (const id of [...boxes.keys()]) if (!ids.has(id)) boxes.delete(id);
      for (const id of [...selected]) if (!ids.has(id)) selected.delete(id);
      show();
    },
  };
}

const reason = (item: { error: { message: string; remedy: string } | null }): string =>
  item.error ? `${item.error.message} ${item.error.remedy}`.trim() : "";

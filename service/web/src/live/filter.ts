/** The switch for a filter behind the method, and the filter's own parameters. */

import type { Method, Params } from "../api/schemas";
import { createForm } from "../forms/schema-form";
import { h } from "../ui/dom";
import type { FilterChoice } from "./types";

export interface FilterSettings {
  element: HTMLElement;
  /** The filter with all its parameters; null while it is off. */
  value(): FilterChoice | null;
  /** Only what differs from the defaults, for the address. */
  changed(): FilterChoice | null;
  problem(name: string, text: string): boolean;
}

/** `filters`: methods that can be a filter. Without any, the element is empty. */
export function createFilter(filters: Method[], chosen: FilterChoice | null, onchange: () => void): FilterSettings {
  const [method] = filters;
  if (!method)
    return { element: h("div", { hidden: true }), value: () => null, changed: () => null, problem: () => false };
  const toggle = createForm(
    {
      properties: {
        on: {
          type: "boolean",
          title: method.title,
          default: false,
          description:
            "Removes flicker of what the method paints. Costs time of its own; frames have the working size.",
        },
      },
    },
    { onchange: switched },
  );
  const form = createForm(method.params_schema, { onchange: () => form.valid() && onchange(), open: 0 });
  const on = () => Boolean(toggle.values().on);

  function switched(): void {
    form.element.hidden = !on();
    onchange();
  }

  toggle.write({ on: chosen?.method === method.name });
  form.write(chosen?.params ?? {});
  form.element.hidden = !on();
  const changed = (): FilterChoice | null => (on() ? { method: method.name, params: form.values() } : null);
  const complete = (params: Params): Params => ({ ...method.defaults, ...params });
  return {
    element: h("div", { class: "live-filter" }, toggle.element, form.element),
    value: () => (on() ? { method: method.name, params: complete(form.values()) } : null),
    changed,
    problem: form.problem,
  };
}

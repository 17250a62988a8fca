/** The settings of one live method: presets, pictures that it refers to, and parameters. */

import type { Inputs, Method, Params } from "../api/schemas";
import type { Draft } from "../forms/draft";
import { createInputs } from "../forms/inputs";
import { createPresets } from "../forms/method-cards";
import { createForm } from "../forms/schema-form";
import { h } from "../ui/dom";

/** Inputs that a running session can replace. */
const PICTURES = ["image", "image-or-video"];

export interface Painting {
  element: HTMLElement;
  method: Method;
  /** The changed parameters. */
  changed(): Params;
  /** Asset ids by input name. */
  given(): Inputs;
  /** All parameters, and all inputs: null where none is given. */
  values(): { params: Params; inputs: Record<string, string | null> };
  problem(area: string, name: string | undefined, text: string): boolean;
  quiet(): void;
}

export function createPainting(method: Method, draft: Pick<Draft, "params" | "inputs">, onpaint: () => void): Painting {
  const form = createForm(method.params_schema, { onchange: painted, open: 0 });
  const presets = createPresets(method.examples ?? [], (values) => {
    form.write(values);
    painted();
  });
  const specs = method.inputs.filter((spec) => PICTURES.includes(spec.kind));
  const inputs = createInputs(specs, draft.inputs, onpaint);
  const none = Object.fromEntries(specs.map((spec) => [spec.name, null]));

  form.write(draft.params);
  presets.match(form.values());

  function painted(): void {
    presets.match(form.values());
    if (form.valid()) onpaint();
  }

  return {
    element: h("div", { class: "live-painting" }, presets.element, inputs.element, form.element),
    method,
    changed: form.values,
    given: inputs.values,
    values: () => ({
      params: { ...method.defaults, ...form.values() },
      inputs: { ...none, ...inputs.values() },
    }),
    problem: (area, name, text) =>
      area === "inputs" ? inputs.problem(name ?? "", text) : form.problem(name ?? area, text),
    quiet() {
      form.quiet();
      inputs.quiet();
    },
  };
}

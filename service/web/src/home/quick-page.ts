/** The quick page: a video, a method, its parameters, one painted frame, and the button that submits the job. */

import * as api from "../api/api";
import type { Asset, Inputs, Method } from "../api/schemas";
import { type Draft, draftHash } from "../forms/draft";
import { createInputs, type InputSlots } from "../forms/inputs";
import { createMethodCards, createPresets, type Presets } from "../forms/method-cards";
import { outputOf, outputSchema } from "../forms/output-form";
import { createForm, type Form } from "../forms/schema-form";
import type { View } from "../ui/dom";
import { fill, h } from "../ui/dom";
import { bytes, describe } from "../ui/format";
import { icon } from "../ui/icons";
import { notify } from "../ui/notices";
import { createPreview } from "./preview";

export interface QuickPageOptions {
  methods: Method[];
  asset: Asset;
  /** Object URL of the file just chosen. */
  localUrl?: string | undefined;
  draft: Draft;
  ondiscard(): void;
  /** Open the present settings as a project in the studio. */
  onopen(draft: Draft): Promise<void>;
}

type Given = Partial<Pick<Draft, "params" | "inputs" | "film">>;

export function createQuickPage({ methods, asset, localUrl, draft, ondiscard, onopen }: QuickPageOptions): View {
  const first = methods.find((method) => method.name === draft.method) ?? methods[0];
  if (!first) throw new api.Problem({ detail: "The service has no method.", code: "no-method" });
  const panel = h("div", { class: "panel-body" });
  const button = h(
    "button",
    { type: "button", class: "button primary submit", onclick: () => send() },
    "Paint the film",
  );
  const problem = h("p", { class: "field-error submit-error", role: "alert" });
  const preview = createPreview({ onframe: save, onproblem: (fault) => place(fault), onpainted: () => quiet() });
  let set = choose(first, draft);

  preview.show(asset, localUrl, draft.frame);
  repaint();

  /** Set the panel up for a method, keeping no parameters of the other method. */
  function choose(method: Method, { params = {}, inputs = {}, film = {} }: Given): MethodPanel {
    const made = createMethodPanel(method, { params, inputs, film }, { changed, save });
    const cards = createMethodCards(methods, method.name, change);
    fill(panel, cards, made.presets.element, made.inputs.element, made.form.element, made.output.element);
    return made;
  }

  function change(name: string): void {
    const method = methods.find((candidate) => candidate.name === name);
    if (!method) return;
    set = choose(method, { film: set.output.values() });
    panel.querySelector<HTMLElement>(".card input:checked")?.focus();
    changed();
  }

  function request() {
    const { seed } = outputOf(set.output.values(), asset);
    return {
      method: set.method.name,
      inputs: { video: asset.id, ...set.inputs.values() },
      params: set.form.values(),
      seed,
    };
  }

  function changed(): void {
    save();
    repaint();
  }

  function repaint(): void {
    set.presets.match(set.form.values());
    if (set.form.valid()) preview.paint(request());
  }

  function present(): Draft {
    const { video = "", ...inputs } = request().inputs as Inputs;
    const film = set.output.values();
    return { method: set.method.name, video, inputs, params: set.form.values(), film, frame: preview.frame };
  }

  function save(): void {
    history.replaceState(null, "", draftHash(present()));
  }

  function quiet(): void {
    problem.textContent = "";
    set.inputs.quiet();
  }

  /** Show a problem beside its field, or below the button if it belongs to none. */
  function place(fault: api.Problem): void {
    const [area = "", ...rest] = fault.field.replace(/^body\./, "").split(".");
    const text = [fault.message, fault.remedy].filter(Boolean).join(" ");
    const name = rest[0] ?? area;
    const places: Record<string, Problems[]> = { params: [set.form], inputs: [set.inputs], output: [set.output] };
    const homes = places[area] ?? [set.output, set.form, set.inputs];
    if (!homes.some((home) => home.problem(name, text))) problem.textContent = text;
  }

  async function send(): Promise<void> {
    if (!set.form.valid() || !set.output.valid()) {
      panel.querySelector<HTMLElement>(".wrong :is(input:not([type=range]), textarea)")?.focus();
      return;
    }
    button.disabled = true;
    try {
      const job = await api.submit({ ...request(), ...outputOf(set.output.values(), asset) }, api.token());
      location.hash = `#/jobs/${job.id}`;
    } catch (error) {
      if (!api.isAbort(error)) reveal(api.asProblem(error));
      button.disabled = false;
    }
  }

  function reveal(fault: api.Problem): void {
    place(fault);
    const wrong = panel.querySelector(".wrong");
    if (wrong) wrong.scrollIntoView({ block: "center" });
    else if (!problem.isConnected) notify(fault);
  }

  const { frames = "?", width, height } = asset.info;
  const facts = h(
    "div",
    { class: "submit-hint" },
    h("span", {}, `${frames} frames`),
    h("span", {}, `${width} × ${height}`),
    problem,
  );
  const open = () => onopen(present()).catch(notify);
  const stage = h("div", { class: "studio-stage" }, heading(asset, open, ondiscard), preview.element);
  const side = h(
    "aside",
    { class: "panel", "aria-label": "Settings" },
    panel,
    h("div", { class: "submit-bar" }, facts, button),
  );
  return { element: h("div", { class: "studio" }, stage, side), close: () => preview.close() };
}

interface Problems {
  problem(name: string, text: string): boolean;
}

/** All parts of the panel that belong to one method. */
interface MethodPanel {
  method: Method;
  form: Form;
  output: Form;
  presets: Presets;
  inputs: InputSlots;
}

function createMethodPanel(
  method: Method,
  given: Required<Given>,
  { changed, save }: { changed: () => void; save: () => void },
): MethodPanel {
  const form = createForm(method.params_schema, { onchange: changed, search: true });
  const output = createForm(outputSchema(method.artefacts ?? []), { onchange: save, open: 0 });
  form.write(given.params);
  output.write(given.film);
  const apply = (values: Draft["params"]) => {
    form.write(values);
    changed();
  };
  const presets = createPresets(method.examples ?? [], apply);
  const specs = method.inputs.filter((input) => input.name !== "video");
  return { method, form, output, presets, inputs: createInputs(specs, given.inputs, changed) };
}

function heading(asset: Asset, onopen: () => void, ondiscard: () => void): HTMLElement {
  const line = `${describe(asset.info)} · ${bytes(asset.size_bytes)}`;
  const damage = asset.info.damage && h("p", { class: "field-error" }, asset.info.damage);
  const text = h("div", { class: "film-title" }, h("h1", {}, asset.filename), h("p", {}, line), damage);
  const other = h("button", { type: "button", class: "button quiet", onclick: ondiscard }, "Another video");
  const draw = h("button", { type: "button", class: "button", onclick: onopen }, icon("brush"), "Draw on it");
  return h("div", { class: "film-head" }, text, h("div", { class: "actions" }, draw, other));
}

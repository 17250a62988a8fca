/** The studio: a video, a method, its parameters, a live frame, and the button that sets it all going. */

import * as api from "./api.js";
import { createMethodCards, createPresets } from "./chooser.js";
import { fill, h } from "./dom.js";
import { draftHash } from "./draft.js";
import { filmSchema, outputOf } from "./film.js";
import { bytes, describe } from "./format.js";
import { createInputs } from "./inputs.js";
import { notify } from "./notices.js";
import { createPreview } from "./preview.js";
import { createForm } from "./schema-form.js";

/**
 * @param {{methods: object[], asset: object, localUrl?: string, draft: object, ondiscard: Function}} scene
 * @returns {{element, close()}}
 */
export function createStudio({ methods, asset, localUrl, draft, ondiscard }) {
  const first = methods.find((m) => m.name === draft.method) ?? methods[0];
  const panel = h("div", { class: "panel-body" });
  const button = h("button", { type: "button", class: "button primary submit", onclick: () => send() }, "Paint the film");
  const problem = h("p", { class: "field-error submit-error", role: "alert" });
  const preview = createPreview({ onframe: save, onproblem: (fault) => place(fault), onpainted: () => quiet() });
  let set = null;

  preview.show(asset, localUrl, draft.frame);
  choose(first.name, draft);

  /** Set the panel up for a method, keeping nothing of the other's parameters. */
  function choose(name, { params = {}, inputs = {}, film = {} }) {
    set = createSet(methods.find((m) => m.name === name), { params, inputs, film }, { changed, save });
    const cards = createMethodCards(methods, name, (other) => (choose(other, { film: set.film.values() }), focusCard(panel), changed()));
    fill(panel, cards, set.presets.element, set.inputs.element, set.form.element, set.film.element);
    repaint();
  }

  function request() {
    const inputs = { video: asset.id, ...set.inputs.values() };
    return { method: set.method.name, inputs, params: set.form.values(), seed: set.film.values().seed ?? 0 };
  }

  function changed() {
    set.presets.match(set.form.values());
    save();
    repaint();
  }

  function repaint() {
    set.presets.match(set.form.values());
    if (set.form.valid()) preview.paint(request());
  }

  function save() {
    const { video, ...inputs } = request().inputs;
    const hash = draftHash({ method: set.method.name, video, inputs, params: set.form.values(), film: set.film.values(), frame: preview.frame });
    history.replaceState(null, "", hash);
  }

  function quiet() {
    problem.textContent = "";
    set.inputs.quiet();
  }

  /** Show a problem beside what caused it, and below the button if nothing did. */
  function place(fault) {
    const [area, ...rest] = fault.field?.replace(/^body\./, "").split(".") ?? [""];
    const text = [fault.message, fault.remedy].filter(Boolean).join(" ");
    const name = rest[0] ?? area;
    const homes = { params: [set.form], inputs: [set.inputs], output: [set.film] }[area] ?? [set.film, set.form, set.inputs];
    if (!homes.some((home) => home.problem(name, text))) problem.textContent = text;
    return fault;
  }

  async function send() {
    if (!set.form.valid() || !set.film.valid()) return panel.querySelector(".wrong :is(input:not([type=range]), textarea)")?.focus();
    button.disabled = true;
    try {
      const job = await api.submit({ ...request(), ...outputOf(set.film.values(), asset) }, api.token());
      location.hash = `#/jobs/${job.id}`;
    } catch (fault) {
      if (fault.name !== "AbortError") reveal(place(fault));
      button.disabled = false;
    }
  }

  function reveal(fault) {
    const wrong = panel.querySelector(".wrong");
    if (wrong) wrong.scrollIntoView({ block: "center" });
    else if (!problem.isConnected) notify(fault);
  }

  const bar = h("div", { class: "submit-bar" }, h("div", { class: "submit-note" }, h("span", {}, `${asset.info.frames ?? "?"} frames`), h("span", {}, `${asset.info.width} × ${asset.info.height}`), problem), button);
  const element = h("div", { class: "studio" }, h("div", { class: "studio-stage" }, heading(asset, ondiscard), preview.element), h("aside", { class: "panel", "aria-label": "Settings" }, panel, bar));
  return { element, close: () => preview.close() };
}

/** Everything of the panel that belongs to one method. */
function createSet(method, given, { changed, save }) {
  const form = createForm(method.params_schema, { onchange: changed });
  const film = createForm(filmSchema(method.artefacts ?? []), { onchange: save, open: 0 });
  form.write(given.params);
  film.write(given.film);
  const presets = createPresets(method.examples ?? [], (values) => (form.write(values), changed()));
  const inputs = createInputs(method.inputs.filter((i) => i.name !== "video"), given.inputs, changed);
  return { method, form, film, presets, inputs };
}

const focusCard = (panel) => panel.querySelector(".card input:checked").focus();

function heading(asset, ondiscard) {
  const text = h("div", { class: "film-title" }, h("h1", {}, asset.filename), h("p", {}, `${describe(asset.info)} · ${bytes(asset.size_bytes)}`));
  return h("div", { class: "film-head" }, text, h("button", { type: "button", class: "button quiet", onclick: ondiscard }, "Another video"));
}

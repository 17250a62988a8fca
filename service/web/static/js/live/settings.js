/** The panel beside the picture: where frames come from, how they are painted, how they travel. */

import { createPresets } from "../chooser.js";
import { h } from "../dom.js";
import { createInputs } from "../inputs.js";
import { createForm } from "../schema-form.js";
import { createSourceChoice } from "./source-choice.js";

/** Pixels of a frame, whatever its shape. */
const AREAS = { small: 320 * 240, medium: 640 * 480, large: 1280 * 720 };
/** Inputs that a session can take up in mid-stream. */
const PICTURES = ["image", "image-or-video"];

const option = (value, title) => ({ const: value, title });

const FRAMES = {
  properties: {
    size: { title: "Size", default: "medium", oneOf: [option("small", "Small"), option("medium", "Medium"), option("large", "Large")], description: "As many pixels as 320 × 240, 640 × 480 or 1280 × 720." },
    fps: { title: "Rate", default: 30, oneOf: [option(15, "15 fps"), option(30, "30 fps"), option(60, "60 fps")] },
  },
};

const WIRE = {
  properties: {
    codec: {
      title: "Codec",
      default: "auto",
      oneOf: [option("auto", "Automatic"), option("h264", "H.264"), option("vp8", "VP8"), option("jpeg", "JPEG")],
      description: "Automatic is the first of these that this browser and the service both have.",
      group: "Connection",
    },
    quality: { title: "Quality", type: "integer", minimum: 1, maximum: 100, default: 85, description: "Of the pictures that come back. Lower needs less of the network.", group: "Connection" },
    adaptive: { title: "Never fall behind", type: "boolean", default: true, description: "Paint at a smaller size when the service cannot keep up, so that the delay never grows.", group: "Connection" },
  },
};

/**
 * @param {object} method as GET /v1/methods has it
 * @param {{params?: object, inputs?: object}} draft
 * @param {{onsource(), onframes(), onpaint(), onwire()}} told of changes: another source; another size or rate; parameters
 *     or references; what `hello` says of codecs
 */
export function createSettings(method, draft, { onsource, onframes, onpaint, onwire }) {
  const source = createSourceChoice(onsource);
  const frames = createForm(FRAMES, { onchange: onframes });
  const paint = createForm(method.params_schema, { onchange: painted, open: 0 });
  const wire = createForm(WIRE, { onchange: onwire, open: 0 });
  const presets = createPresets(method.examples ?? [], (values) => (paint.write(values), painted()));
  const specs = method.inputs.filter((spec) => PICTURES.includes(spec.kind));
  const inputs = createInputs(specs, draft.inputs ?? {}, onpaint);
  const none = Object.fromEntries(specs.map((spec) => [spec.name, null]));

  paint.write(draft.params ?? {});
  presets.match(paint.values());

  function painted() {
    presets.match(paint.values());
    if (paint.valid()) onpaint();
  }

  return {
    element: h("div", { class: "panel-body" }, h("div", { class: "live-from" }, source.element, frames.element), presets.element, inputs.element, paint.element, wire.element),
    source,
    /** All that a stream wants to know, as it is set now. Inputs that are not given are null. */
    values() {
      const { size = "medium", fps = 30 } = frames.values();
      const { codec = "auto", quality = 85, adaptive = true } = wire.valid() ? wire.values() : {};
      const params = { ...method.defaults, ...paint.values() };
      return { method: method.name, params, inputs: { ...none, ...inputs.values() }, area: AREAS[size], fps, codec, quality, adaptive };
    },
    /** What differs from the defaults, for the address. */
    draft: () => ({ method: method.name, params: paint.values(), inputs: inputs.values() }),
    /** Show a problem beside what caused it; false if nothing here did. */
    problem(fault) {
      const [area, name] = (fault.field ?? "").split(".");
      const text = [fault.message, fault.remedy].filter(Boolean).join(" ");
      return area === "inputs" ? inputs.problem(name, text) : paint.problem(name ?? area, text);
    },
    quiet: () => (paint.quiet(), inputs.quiet()),
  };
}

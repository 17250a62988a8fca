/** The panel beside the picture: the source of the frames, the parameters of the painting, the connection. */

import { createInputs } from "../forms/inputs";
import { createPresets } from "../forms/method-cards";
import { createForm } from "../forms/schema-form";
import type { Problem } from "../shared/api";
import { h } from "../shared/dom";
import type { Draft } from "../shared/draft";
import type { Method, Params, Schema } from "../shared/types";
import { createSourceChoice, type SourceChoice } from "./source-choice";
import type { LiveSettings } from "./types";

/** Pixels of a frame, whatever its shape. */
const AREAS: Record<string, number> = { small: 320 * 240, medium: 640 * 480, large: 1280 * 720 };
/** Inputs that a running session can replace. */
const PICTURES = ["image", "image-or-video"];

const option = (value: string | number, title: string): Schema => ({ const: value, title });

const FRAMES: Schema = {
  properties: {
    size: {
      title: "Size",
      default: "medium",
      oneOf: [option("small", "Small"), option("medium", "Medium"), option("large", "Large")],
      description: "As many pixels as 320 × 240, 640 × 480 or 1280 × 720.",
    },
    fps: { title: "Rate", default: 30, oneOf: [option(15, "15 fps"), option(30, "30 fps"), option(60, "60 fps")] },
  },
};

const WIRE: Schema = {
  properties: {
    codec: {
      title: "Codec",
      default: "auto",
      oneOf: [option("auto", "Automatic"), option("h264", "H.264"), option("vp8", "VP8"), option("jpeg", "JPEG")],
      description: "Automatic is the first of these that this browser and the service both have.",
      group: "Connection",
    },
    quality: {
      title: "Quality",
      type: "integer",
      minimum: 1,
      maximum: 100,
      default: 85,
      description: "Quality of the returned pictures. Lower values need less bandwidth.",
      group: "Connection",
    },
    adaptive: {
      title: "Never fall behind",
      type: "boolean",
      default: true,
      description: "Paint at a smaller size when the service cannot keep up, so that the delay never grows.",
      group: "Connection",
    },
  },
};

export interface SettingsEvents {
  /** Another source. */
  onsource(): void;
  /** Another size or rate. */
  onframes(): void;
  /** Other parameters or references. */
  onpaint(): void;
  /** Other codecs, quality or adaptivity: they are part of `hello`. */
  onwire(): void;
}

export interface Settings {
  element: HTMLElement;
  source: SourceChoice;
  values(): LiveSettings;
  /** The values that differ from the defaults, for the address. */
  draft(): Partial<Draft>;
  /** Show a problem beside its field; false if there is no such field. */
  problem(fault: Pick<Problem, "field" | "message" | "remedy">): boolean;
  quiet(): void;
}

export function createSettings(
  method: Method,
  draft: Draft,
  { onsource, onframes, onpaint, onwire }: SettingsEvents,
): Settings {
  const source = createSourceChoice(onsource);
  const frames = createForm(FRAMES, { onchange: onframes });
  const paint = createForm(method.params_schema, { onchange: painted, open: 0 });
  const wire = createForm(WIRE, { onchange: onwire, open: 0 });
  const presets = createPresets(method.examples ?? [], (values) => {
    paint.write(values);
    painted();
  });
  const specs = method.inputs.filter((spec) => PICTURES.includes(spec.kind));
  const inputs = createInputs(specs, draft.inputs, onpaint);
  const none = Object.fromEntries(specs.map((spec) => [spec.name, null]));

  paint.write(draft.params);
  presets.match(paint.values());

  function painted(): void {
    presets.match(paint.values());
    if (paint.valid()) onpaint();
  }

  function values(): LiveSettings {
    const given: Params = {
      size: "medium",
      fps: 30,
      codec: "auto",
      quality: 85,
      adaptive: true,
      ...frames.values(),
      ...(wire.valid() && wire.values()),
    };
    return {
      method: method.name,
      params: { ...method.defaults, ...paint.values() },
      inputs: { ...none, ...inputs.values() },
      area: AREAS[String(given.size)] ?? 640 * 480,
      fps: Number(given.fps),
      codec: String(given.codec),
      quality: Number(given.quality),
      adaptive: Boolean(given.adaptive),
    };
  }

  const from = h("div", { class: "live-from" }, source.element, frames.element);
  return {
    element: h("div", { class: "panel-body" }, from, presets.element, inputs.element, paint.element, wire.element),
    source,
    values,
    draft: () => ({ method: method.name, params: paint.values(), inputs: inputs.values() }),
    problem(fault) {
      const [area = "", name] = fault.field.split(".");
      const text = [fault.message, fault.remedy].filter(Boolean).join(" ");
      return area === "inputs" ? inputs.problem(name ?? "", text) : paint.problem(name ?? area, text);
    },
    quiet() {
      paint.quiet();
      inputs.quiet();
    },
  };
}

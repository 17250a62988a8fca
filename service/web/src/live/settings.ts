/** The panel beside the picture: the source of the frames, the parameters of the painting, the connection. */

import type { Problem } from "../api/api";
import type { Method, Params, Schema } from "../api/schemas";
import type { Draft } from "../forms/draft";
import { createForm } from "../forms/schema-form";
import { h } from "../ui/dom";
import { createFilter } from "./filter";
import { createPainting } from "./painting";
import { createSourceChoice, type SourceChoice } from "./source-choice";
import type { FilterChoice, LiveSettings } from "./types";

/** Pixels of a frame, whatever its shape. */
const AREAS: Record<string, number> = { small: 320 * 240, medium: 640 * 480, large: 1280 * 720 };

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
  },
};

export interface SettingsEvents {
  /** Another source. */
  onsource(): void;
  /** Another size or rate. */
  onframes(): void;
  /** Another method, filter, parameter or reference. */
  onpaint(): void;
  /** Another method, preference, codec or quality: they are part of `hello`. */
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

export interface Choice {
  /** Methods that can run live, at least one. */
  methods: Method[];
  /** Methods that can filter what such a method paints. */
  filters: Method[];
}

export function createSettings(
  { methods, filters }: Choice,
  draft: Draft,
  { onsource, onframes, onpaint, onwire }: SettingsEvents,
): Settings {
  const source = createSourceChoice(onsource);
  const frames = createForm(FRAMES, { onchange: onframes });
  const wire = createForm(WIRE, { onchange: onwire, open: 0 });
  const choice = createForm(methodSchema(methods), { onchange: chosen });
  const filter = createFilter(filters, readFilter(draft), onpaint);
  let painting = createPainting(named(draft.method), draft, onpaint);
  choice.write({ method: painting.method.name, ...(draft.film.prefer === "sharp" && { prefer: "sharp" }) });

  function named(name: string): Method {
    const method = methods.find((each) => each.name === name) ?? methods[0];
    if (!method) throw new Error("There is no live method.");
    return method;
  }

  /** Another method, or another preference: both are part of `hello`. */
  function chosen(): void {
    const next = named(String(choice.values().method ?? methods[0]?.name));
    if (next !== painting.method) {
      const before = painting.element;
      painting = createPainting(next, { params: {}, inputs: {} }, onpaint);
      before.replaceWith(painting.element);
    }
    onpaint();
    onwire();
  }

  function values(): LiveSettings {
    const given: Params = {
      size: "medium",
      fps: 30,
      codec: "auto",
      quality: 85,
      prefer: "fluent",
      ...choice.values(),
      ...frames.values(),
      ...(wire.valid() && wire.values()),
    };
    return {
      method: painting.method.name,
      ...painting.values(),
      filter: filter.value(),
      prefer: given.prefer === "sharp" ? "sharp" : "fluent",
      area: AREAS[String(given.size)] ?? 640 * 480,
      fps: Number(given.fps),
      codec: String(given.codec),
      quality: Number(given.quality),
    };
  }

  /** What the address keeps: the preference and the filter are values of the draft's `film`. */
  function kept(): Partial<Draft> {
    const behind = filter.changed();
    const film: Params = {
      ...(values().prefer === "sharp" && { prefer: "sharp" }),
      ...(behind && { filter: behind.method, filterParams: behind.params }),
    };
    return { method: painting.method.name, params: painting.changed(), inputs: painting.given(), film };
  }

  const from = h("div", { class: "live-from" }, source.element, frames.element);
  return {
    element: h("div", { class: "panel-body" }, from, choice.element, painting.element, filter.element, wire.element),
    source,
    values,
    draft: kept,
    problem(fault) {
      const [area = "", name, last] = fault.field.split(".");
      const text = [fault.message, fault.remedy].filter(Boolean).join(" ");
      return area === "filter" ? filter.problem(last ?? "", text) : painting.problem(area, name, text);
    },
    quiet: () => painting.quiet(),
  };
}

/** What to paint with, and what to keep when frames take too long. */
function methodSchema(methods: Method[]): Schema {
  const method: Schema = {
    title: "Method",
    default: methods[0]?.name ?? "",
    oneOf: methods.map(({ name, title }) => option(name, title)),
  };
  const prefer: Schema = {
    title: "When frames take too long",
    default: "fluent",
    oneOf: [option("fluent", "Fluent"), option("sharp", "Sharp")],
    description: "Fluent keeps the rate and works at a smaller size. Sharp keeps the size and drops frames.",
  };
  return { properties: { ...(methods.length > 1 && { method }), prefer } };
}

function readFilter({ film }: Draft): FilterChoice | null {
  const params = film.filterParams;
  if (typeof film.filter !== "string") return null;
  const given = params && typeof params === "object" && !Array.isArray(params) ? { ...params } : {};
  return { method: film.filter, params: given };
}

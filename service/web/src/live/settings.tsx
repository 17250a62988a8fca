/** The panel beside the picture: the source of the frames, the parameters of the painting, the connection. */

import { signal } from "@preact/signals";
import { useMemo } from "preact/hooks";
import type { Problem } from "../api/api";
import type { Inputs as Given, Method, Params, Schema } from "../api/schemas";
import { applies } from "../forms/applies";
import type { ColourScheme } from "../forms/colour-scheme";
import type { Draft } from "../forms/draft";
import { Inputs } from "../forms/inputs";
import { Presets } from "../forms/method-cards";
import { Form, hasField } from "../forms/schema-form";
import { SchemeInput } from "./scheme-input";
import { type SourceChoice, SourceChooser } from "./source-choice";
import type { FilterChoice, LiveSettings } from "./types";

/** Pixels of a frame, whatever its shape. */
const AREAS: Record<string, number> = { small: 320 * 240, medium: 640 * 480, large: 1280 * 720 };
/** Inputs that a running session can replace. */
const PICTURES = ["image", "image-or-video"];

const LIVE = { stream: true };

/** Whether all parameters of an example have an effect on a stream. */
const isLive = (method: Method, params: Params): boolean =>
  Object.keys(params).every((name) =>
    applies(method.params_schema.properties?.[name]?.applies_when, { ...method.defaults, ...params }, LIVE),
  );

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
  /** Another size or rate. */
  onframes(): void;
  /** Another method, filter, parameter or reference. */
  onpaint(): void;
  /** Another method, preference, codec or quality: they are part of `hello`. */
  onwire(): void;
}

export interface Choice {
  /** Methods that can run live, at least one. */
  methods: Method[];
  /** Methods that can filter what such a method paints. */
  filters: Method[];
}

/** What the user has chosen; only values that differ from the defaults. */
interface Chosen {
  method: Method;
  params: Params;
  inputs: Given;
  filtered: boolean;
  filterParams: Params;
  prefer: "fluent" | "sharp";
  frames: Params;
  wire: Params;
}

type Faults = Record<"params" | "inputs" | "filter", Record<string, string>>;
const NO_FAULTS: Faults = { params: {}, inputs: {}, filter: {} };

export class Settings {
  readonly chosen;
  readonly faults = signal(NO_FAULTS);

  constructor(
    readonly choice: Choice,
    draft: Draft,
    readonly events: SettingsEvents,
  ) {
    const method = choice.methods.find(({ name }) => name === draft.method) ?? choice.methods[0];
    if (!method) throw new Error("There is no live method.");
    const filter = readFilter(draft);
    this.chosen = signal<Chosen>({
      method,
      params: draft.params,
      inputs: draft.inputs,
      filtered: filter !== null && filter.method === this.filter?.name,
      filterParams: filter?.params ?? {},
      prefer: draft.film.prefer === "sharp" ? "sharp" : "fluent",
      frames: {},
      wire: {},
    });
  }

  /** The method that can remove the flicker of the others, if there is one. */
  get filter(): Method | undefined {
    return this.choice.filters[0];
  }

  change(part: Partial<Chosen>, ...events: (keyof SettingsEvents)[]): void {
    this.chosen.value = { ...this.chosen.peek(), ...part };
    for (const event of events) this.events[event]();
  }

  values(): LiveSettings {
    const { method, params, inputs, prefer, frames, wire } = this.chosen.peek();
    const given: Params = { size: "medium", fps: 30, codec: "auto", quality: 85, ...frames, ...wire };
    const none = Object.fromEntries(inputsOf(method).map(({ name }) => [name, null]));
    return {
      method: method.name,
      params: { ...method.defaults, ...params },
      inputs: { ...none, ...inputs },
      filter: this.filterChoice(this.filter?.defaults),
      prefer,
      area: AREAS[String(given.size)] ?? 640 * 480,
      fps: Number(given.fps),
      codec: String(given.codec),
      quality: Number(given.quality),
    };
  }

  private filterChoice(defaults: Params = {}): FilterChoice | null {
    const { filtered, filterParams } = this.chosen.peek();
    return this.filter && filtered ? { method: this.filter.name, params: { ...defaults, ...filterParams } } : null;
  }

  /** What the address keeps: the preference and the filter are values of the draft's `film`. */
  draft(): Partial<Draft> {
    const { method, params, inputs, prefer } = this.chosen.peek();
    const behind = this.filterChoice();
    const film: Params = {
      ...(prefer === "sharp" && { prefer }),
      ...(behind && { filter: behind.method, filterParams: behind.params }),
    };
    return { method: method.name, params, inputs, film };
  }

  /** Show a problem beside its field; false if there is no such field. */
  problem({ field, message, remedy }: Pick<Problem, "field" | "message" | "remedy">): boolean {
    const [area = "", second, last] = field.split(".");
    const home = area === "filter" || area === "inputs" ? area : "params";
    const name = (home === "filter" ? last : second) ?? (home === "params" ? area : "");
    const { method } = this.chosen.peek();
    const known = {
      inputs: inputsOf(method).some((spec) => spec.name === name),
      params: hasField(method.params_schema, name),
      filter: Boolean(this.filter && hasField(this.filter.params_schema, name)),
    }[home];
    if (known) this.faults.value = { ...NO_FAULTS, [home]: { [name]: [message, remedy].filter(Boolean).join(" ") } };
    return known;
  }

  /** Give an input, or take it away: an empty id. */
  setInput(name: string, id: string): void {
    const { [name]: _old, ...rest } = this.chosen.peek().inputs;
    this.change({ inputs: id ? { ...rest, [name]: id } : rest }, "onpaint");
  }

  quiet(): void {
    this.faults.value = NO_FAULTS;
  }
}

const picturesOf = (method: Method) => method.inputs.filter((spec) => PICTURES.includes(spec.kind));

/** The sections of the studio that a running session has, too, with the inputs that are made from them. */
const schemesOf = (method: Method) =>
  method.studio.sections.flatMap((section) => {
    const input = method.inputs.find(({ kind, part }) => kind === "json" && part === section.part);
    return section.editor === "histogram" && input ? [{ section, input }] : [];
  });

const inputsOf = (method: Method) => [...picturesOf(method), ...schemesOf(method).map(({ input }) => input)];

interface SettingsPanelProps {
  settings: Settings;
  source: SourceChoice;
  /** The colour scheme of what is painted. */
  scene: ColourScheme | null;
}

export function SettingsPanel({ settings, source, scene }: SettingsPanelProps) {
  const { method, params, inputs, frames, wire } = settings.chosen.value;
  const faults = settings.faults.value;
  return (
    <div class="panel-body">
      <div class="live-from">
        <SourceChooser choice={source} />
        <Form schema={FRAMES} values={frames} onChange={(values) => settings.change({ frames: values }, "onframes")} />
      </div>
      <MethodChoice settings={settings} />
      <div class="live-painting" key={method.name}>
        <Presets
          examples={method.examples.filter((example) => isLive(method, example.params))}
          params={params}
          onChoose={(values) => settings.change({ params: values }, "onpaint")}
        />
        <Inputs
          specs={picturesOf(method)}
          given={inputs}
          faults={faults.inputs}
          onChange={(given) => settings.change({ inputs: given }, "onpaint")}
        />
        {schemesOf(method).map(({ section, input }) => (
          <SchemeInput
            key={input.name}
            section={section}
            fault={faults.inputs[input.name] ?? ""}
            id={inputs[input.name] ?? ""}
            source={scene}
            onChange={(id) => settings.setInput(input.name, id)}
          />
        ))}
        <Form
          schema={method.params_schema}
          values={params}
          faults={faults.params}
          situation={LIVE}
          open={0}
          onChange={(values, valid) => valid && settings.change({ params: values }, "onpaint")}
        />
      </div>
      {settings.filter && <FilterSettings settings={settings} filter={settings.filter} faults={faults.filter} />}
      <Form
        schema={WIRE}
        values={wire}
        open={0}
        onChange={(values, valid) => valid && settings.change({ wire: values }, "onwire")}
      />
    </div>
  );
}

/** What to paint with, and what to keep when frames take too long. */
function MethodChoice({ settings }: { settings: Settings }) {
  const { methods } = settings.choice;
  const { method, prefer } = settings.chosen.value;
  const schema = useMemo(() => methodSchema(methods), [methods]);
  const values = useMemo(
    () => ({ ...(method !== methods[0] && { method: method.name }), ...(prefer === "sharp" && { prefer }) }),
    [method, prefer],
  );
  const change = (given: Params) => {
    const next = methods.find(({ name }) => name === given.method) ?? methods[0] ?? method;
    const other = next === method ? {} : { method: next, params: {}, inputs: {} };
    settings.change({ ...other, prefer: given.prefer === "sharp" ? "sharp" : "fluent" }, "onpaint", "onwire");
  };
  return <Form schema={schema} values={values} onChange={change} />;
}

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

interface FilterSettingsProps {
  settings: Settings;
  filter: Method;
  faults: Record<string, string>;
}

/** The switch for a filter behind the method, and the filter's own parameters. */
function FilterSettings({ settings, filter, faults }: FilterSettingsProps) {
  const { filtered, filterParams } = settings.chosen.value;
  const schema = useMemo(() => switchSchema(filter.title), [filter]);
  const values = useMemo((): Params => (filtered ? { on: true } : {}), [filtered]);
  return (
    <div class="live-filter">
      <Form
        schema={schema}
        values={values}
        onChange={({ on }) => settings.change({ filtered: Boolean(on) }, "onpaint")}
      />
      {filtered && (
        <Form
          schema={filter.params_schema}
          values={filterParams}
          faults={faults}
          open={0}
          onChange={(params, valid) => valid && settings.change({ filterParams: params }, "onpaint")}
        />
      )}
    </div>
  );
}

const switchSchema = (title: string): Schema => ({
  properties: {
    on: {
      type: "boolean",
      title,
      default: false,
      description: "Removes flicker of what the method paints. Costs time of its own; frames have the working size.",
    },
  },
});

function readFilter({ film }: Draft): FilterChoice | null {
  const params = film.filterParams;
  if (typeof film.filter !== "string") return null;
  const given = params && typeof params === "object" && !Array.isArray(params) ? { ...params } : {};
  return { method: film.filter, params: given };
}

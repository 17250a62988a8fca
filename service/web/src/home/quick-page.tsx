/** The quick page: a video, a method, its parameters, one painted frame, and the button that submits the job. */

import { useLayoutEffect, useMemo, useRef, useState } from "preact/hooks";
import * as api from "../api/api";
import type { Asset, Inputs as Given, Method, Params } from "../api/schemas";
import { applies } from "../forms/applies";
import { type Draft, draftHash } from "../forms/draft";
import { Inputs } from "../forms/inputs";
import { MethodCards, Presets } from "../forms/method-cards";
import { outputOf, outputSchema } from "../forms/output-form";
import { Form, hasField } from "../forms/schema-form";
import { bytes, describe } from "../ui/format";
import { Icon } from "../ui/icons";
import { notify } from "../ui/notices";
import { Preview } from "./preview";

export interface QuickPageProps {
  methods: Method[];
  asset: Asset;
  /** Object URL of the file just chosen. */
  localUrl?: string | undefined;
  draft: Draft;
  ondiscard(): void;
  /** Open the present settings as a project in the studio. */
  onopen(draft: Draft): Promise<void>;
}

/** Problems beside their fields, by name; `rest`: one that belongs to no field. */
interface Faults {
  params: Record<string, string>;
  inputs: Record<string, string>;
  output: Record<string, string>;
  rest: string;
}

const NO_FAULTS: Faults = { params: {}, inputs: {}, output: {}, rest: "" };

/** What the panel sets. */
interface Settings {
  method: Method;
  params: Params;
  inputs: Given;
  film: Params;
}

export function QuickPage({ methods, asset, localUrl, draft, ondiscard, onopen }: QuickPageProps) {
  const first = methods.find(({ name }) => name === draft.method) ?? methods[0];
  if (!first) throw new api.Problem({ detail: "The service has no method.", code: "no-method" });
  const [set, setSet] = useState<Settings>({ ...draft, method: first });
  const [valid, setValid] = useState({ params: true, film: true });
  const [frame, setFrame] = useState(draft.frame ?? Math.floor((asset.info.frames ?? 1) / 3));
  const [faults, setFaults] = useState(NO_FAULTS);
  const panel = useRef<HTMLElement>(null);
  const values = { ...set.method.defaults, ...set.params };
  const situation = { inputs: Object.keys(set.inputs), piece: false, passes: asset.info.passes?.kinds };
  const specs = set.method.inputs.filter(
    ({ name, applies_when }) => name !== "video" && (name in set.inputs || applies(applies_when, values, situation)),
  );
  const output = useMemo(() => outputSchema(set.method, set.film.format as string), [set.method, set.film.format]);
  const made = outputOf(set.film, asset);
  const request = {
    method: set.method.name,
    inputs: { video: asset.id, ...set.inputs },
    params: set.params,
    seed: made.seed,
  };
  const present: Draft = { ...set, method: set.method.name, video: asset.id, frame };
  // Before the next paint, so that a reload at any time restores what is shown.
  useLayoutEffect(() => history.replaceState(null, "", draftHash(present)), [JSON.stringify(present)]);

  const change = (part: Partial<Settings>) => {
    setSet((old) => ({ ...old, ...part }));
    setFaults(NO_FAULTS);
  };

  /** A problem beside its field, or below the button if it belongs to none. */
  function place(problem: api.Problem): void {
    const [area = "", ...rest] = problem.field.replace(/^body\./, "").split(".");
    const name = rest[0] ?? area;
    const text = [problem.message, problem.remedy].filter(Boolean).join(" ");
    const known = {
      output: hasField(output, name),
      params: hasField(set.method.params_schema, name),
      inputs: specs.some((spec) => spec.name === name),
    };
    const areas = area in known ? [area as keyof typeof known] : (["output", "params", "inputs"] as const);
    const home = areas.find((each) => known[each]);
    setFaults(home ? { ...NO_FAULTS, [home]: { [name]: text } } : { ...NO_FAULTS, rest: text });
  }

  const wrong = (selector: string) =>
    requestAnimationFrame(() => {
      const field = panel.current?.querySelector<HTMLElement>(selector);
      field?.scrollIntoView({ block: "center" });
      field?.focus();
    });

  async function send(): Promise<void> {
    if (!valid.params || !valid.film) {
      wrong(".wrong :is(input:not([type=range]), textarea)");
      return;
    }
    try {
      const job = await api.submit({ ...request, ...made }, api.token());
      location.hash = `#/jobs/${job.id}`;
    } catch (error) {
      if (api.isAbort(error)) return;
      place(api.asProblem(error));
      wrong(".wrong");
    }
  }

  return (
    <div class="studio">
      <div class="studio-stage">
        <Heading asset={asset} onopen={() => onopen(present).catch(notify)} ondiscard={ondiscard} />
        <Preview
          asset={asset}
          localUrl={localUrl}
          frame={frame}
          onframe={setFrame}
          request={valid.params ? request : null}
          onpainted={(problem) => (problem ? place(problem) : setFaults((old) => ({ ...old, inputs: {}, rest: "" })))}
        />
      </div>
      <aside class="panel" aria-label="Settings" ref={panel}>
        <div class="panel-body">
          <MethodCards
            methods={methods}
            chosen={set.method.name}
            onChoose={(name) => {
              const method = methods.find((candidate) => candidate.name === name);
              if (method) change({ method, params: {}, inputs: {} });
            }}
          />
          <Presets
            examples={set.method.examples}
            params={set.params}
            onChoose={(params) => {
              setValid({ ...valid, params: true });
              change({ params });
            }}
          />
          <Inputs
            key={`inputs-${set.method.name}`}
            specs={specs}
            given={set.inputs}
            faults={faults.inputs}
            onChange={(inputs) => change({ inputs })}
          />
          <Form
            key={`params-${set.method.name}`}
            schema={set.method.params_schema}
            values={set.params}
            faults={faults.params}
            situation={situation}
            search
            onChange={(params, parsed) => {
              setValid({ ...valid, params: parsed });
              change({ params });
            }}
          />
          <Form
            key={`film-${set.method.name}`}
            schema={output}
            values={set.film}
            faults={faults.output}
            open={0}
            onChange={(film, parsed) => {
              setValid({ ...valid, film: parsed });
              change({ film });
            }}
          />
        </div>
        <SubmitBar asset={asset} problem={faults.rest} send={send} />
      </aside>
    </div>
  );
}

function SubmitBar({ asset, problem, send }: { asset: Asset; problem: string; send(): Promise<void> }) {
  const [sending, setSending] = useState(false);
  const { frames = "?", width, height } = asset.info;
  return (
    <div class="submit-bar">
      <div class="submit-hint">
        <span>{`${frames} frames`}</span>
        <span>{`${width} × ${height}`}</span>
        <p class="field-error submit-error" role="alert">
          {problem}
        </p>
      </div>
      <button
        type="button"
        class="button primary submit"
        disabled={sending}
        onClick={() => {
          setSending(true);
          send().finally(() => setSending(false));
        }}
      >
        Paint the film
      </button>
    </div>
  );
}

function Heading({ asset, onopen, ondiscard }: { asset: Asset; onopen(): void; ondiscard(): void }) {
  return (
    <div class="film-head">
      <div class="film-title">
        <h1>{asset.filename}</h1>
        <p>{`${describe(asset.info)} · ${bytes(asset.size_bytes)}`}</p>
        {asset.info.damage && <p class="field-error">{asset.info.damage}</p>}
      </div>
      <div class="actions">
        <button type="button" class="button" onClick={onopen}>
          <Icon name="brush" />
          Draw on it
        </button>
        <button type="button" class="button quiet" onClick={ondiscard}>
          Another video
        </button>
      </div>
    </div>
  );
}

/** The panel beside the stage: the method, its main inputs, all settings, output, and the button that submits. */

import { useMemo, useRef } from "preact/hooks";
import type { Method, Params, Section } from "../../api/schemas";
import { applies, type Situation } from "../../forms/applies";
import { Inputs } from "../../forms/inputs";
import { MethodCards, Presets } from "../../forms/method-cards";
import { fitting, outputSchema } from "../../forms/output-form";
import { Form } from "../../forms/schema-form";
import { notify } from "../../ui/notices";
import type { Clusters } from "../clusters/clusters";
import { ClustersSection } from "../clusters/clusters-section";
import { addAsset, changeLayer, inputsOf, type Layer, type LayerPlace } from "../document/document";
import type { Film } from "../films/film";
import type { FilmFrame, Films } from "../films/films";
import { SubmitBar } from "../films/submit-bar";
import type { Foreground } from "../keys/foreground";
import type { KeyActions } from "../keys/key-actions";
import type { PaintedKeys } from "../keys/keys";
import { KeysSection } from "../keys/keys-section";
import { MarksSection } from "../keys/marks-section";
import type { LayerMatte } from "../keys/matte";
import { usePresetPictures } from "../previews/preset-pictures";
import type { FilmView } from "../regions/film-view";
import type { RegionMaps } from "../regions/region-map";
import { RegionsSection } from "../regions/regions-section";
import type { Field } from "../regions/true-field";
import type { Store } from "../state/store";
import { SchemeSection } from "../styles/scheme-section";
import { StyleLibrary } from "../styles/style-library";
import { LayersSection } from "./layers-section";
import { Lesson } from "./lesson";
import { Variants } from "./variants";

export interface PanelProps {
  store: Store;
  film: Film;
  films: Films;
  keys: PaintedKeys;
  actions: KeyActions;
  clusters: Clusters;
  foreground: Foreground;
  matte: LayerMatte;
  maps: RegionMaps;
  field: FilmView<Field>;
  /** Save everything; false if that failed. */
  saveAll(): Promise<boolean>;
  /** Make the present painting of the shown frame a key. */
  correct(): Promise<void>;
  /** Make a frame of a finished film a key. */
  take(frame: FilmFrame): Promise<void>;
  /** Find frames that are worth a key. */
  suggest(): Promise<void>;
}

export function Panel({
  store,
  film,
  films,
  keys,
  actions,
  clusters,
  foreground,
  matte,
  maps,
  field,
  saveAll,
  correct,
  take,
  suggest,
}: PanelProps) {
  const method = store.method.value;
  const methods = useRef<HTMLDetailsElement>(null);
  /** Whether the keyboard was used last: arrow keys choose one method after another, and Enter ends that. */
  const keyed = useRef(false);
  const close = () => methods.current?.removeAttribute("open");
  return (
    <aside class="panel designer-panel" aria-label="Settings">
      <div class="panel-body">
        <Lesson store={store} />
        <details
          class="group method-choice"
          open={!method}
          ref={methods}
          onPointerDown={() => {
            keyed.current = false;
          }}
          onKeyDown={(event) => {
            keyed.current = true;
            if (event.key !== "Enter" || !(event.target instanceof HTMLInputElement)) return;
            event.preventDefault(); // it would open the list again
            close();
            methods.current?.querySelector("summary")?.focus();
          }}
        >
          <summary>
            <span>{method?.title ?? "Method"}</span>
          </summary>
          <MethodCards
            methods={store.methods}
            chosen={store.layer.value.method}
            onChoose={(name) => {
              choose(store, name);
              if (!keyed.current) close();
            }}
          />
        </details>
        {method && (
          <MethodParts
            key={`${store.layer.value.id}-${method.name}`}
            store={store}
            film={film}
            films={films}
            keys={keys}
            actions={actions}
            clusters={clusters}
            foreground={foreground}
            matte={matte}
            maps={maps}
            field={field}
            solve={() => films.submit(saveAll).catch(notify)}
            method={method}
            saveAll={saveAll}
            correct={correct}
            take={take}
            suggest={suggest}
          />
        )}
      </div>
      <SubmitBar store={store} film={film} films={films} saveAll={saveAll} />
    </aside>
  );
}

interface MethodPartsProps extends PanelProps {
  method: Method;
  /** Paint the film. */
  solve(): void;
}

function MethodParts(props: MethodPartsProps) {
  const { store, method, matte, saveAll } = props;
  return (
    <>
      {method.studio.sections.map((section) => (
        <PartSection key={section.part} {...props} section={section} />
      ))}
      <StyleLibrary store={store} method={method} />
      <LayerInputs store={store} method={method} />
      <AllSettings store={store} method={method} />
      <LayersSection store={store} matte={matte} />
      <Variants store={store} saveAll={saveAll} />
      <OutputSettings store={store} method={method} />
    </>
  );
}

/** The editor of one part of the layer. */
function PartSection({ section, ...props }: MethodPartsProps & { section: Section }) {
  const { store, keys, actions, clusters, foreground, maps, field, correct, take, suggest, solve } = props;
  const editors = {
    keys: () => (
      <KeysSection
        store={store}
        section={section}
        keys={keys}
        actions={actions}
        correct={correct}
        take={take}
        suggest={suggest}
      />
    ),
    marks: () => <MarksSection store={store} section={section} keys={keys} foreground={foreground} />,
    clusters: () => <ClustersSection store={store} section={section} clusters={clusters} solve={solve} />,
    regions: () => <RegionsSection store={store} section={section} maps={maps} field={field} />,
    histogram: () => <SchemeSection store={store} section={section} />,
  };
  return editors[section.editor]();
}

function choose(store: Store, method: string): void {
  store.tool.value = "pan";
  store.editLayer("Change the method", (layer) => ({ ...layer, method, params: {} }));
}

/** The inputs that are plain files; painted keys, designs and masks are made on the stage instead. */
function LayerInputs({ store, method }: { store: Store; method: Method }) {
  const { inputs = NONE, params } = store.layer.value;
  const values = { ...method.defaults, ...params };
  const situation = situationOf(store, method);
  const specs = method.inputs.filter(
    (spec) =>
      spec.name !== "video" &&
      (spec.required || ["image", "image-or-video"].includes(spec.kind)) &&
      (spec.name in inputs || applies(spec.applies_when, values, situation)),
  );
  const main = specs.filter((spec) => spec.name === method.studio.painting);
  const ordered = [...main, ...specs.filter((spec) => !main.includes(spec))];
  const assets = store.document.value.assets;
  const given = Object.fromEntries(
    Object.entries(store.layer.value.inputs ?? {}).map(([name, asset]) => [name, assets[asset]?.id ?? ""]),
  );
  const { place } = store; // another layer may be selected when an upload ends
  return <Inputs specs={ordered} given={given} onChange={(values) => setInputs(store, place, values)} />;
}

function setInputs(store: Store, place: LayerPlace, values: Record<string, string>): void {
  store.editDocument("Change an input", (document) => {
    let next = document;
    const inputs: Record<string, string> = {};
    for (const [name, id] of Object.entries(values))
      [next, inputs[name]] = addAsset(next, name, { id }) as [typeof next, string];
    return changeLayer(next, place, (layer) => ({ ...layer, inputs }));
  });
}

/** What is known of the layer's inputs and of the shot's video. A layer with a video of its own has no passes. */
function situationOf(store: Store, method: Method): Situation {
  const inputs = inputsOf(store.layer.value, method.inputs);
  const passes = store.layer.value.inputs?.video ? [] : store.asset.info.passes?.kinds;
  return { inputs, passes };
}

const NONE: Params = {};

/** Presets and the form of all parameters. */
function AllSettings({ store, method }: { store: Store; method: Method }) {
  const { params = NONE } = store.layer.value;
  const pictures = usePresetPictures(store, method.examples);
  return (
    <div class="all-settings">
      <Presets
        examples={method.examples}
        params={params}
        pictures={pictures}
        ratio={store.size.width / store.size.height}
        onChoose={(chosen) => store.editLayer("Use a preset", (layer) => ({ ...layer, params: chosen }))}
      />
      <Form
        schema={method.params_schema}
        values={params}
        open={0}
        situation={situationOf(store, method)}
        search
        time={{ frame: store.frame, span: store.reach }}
        onChange={(values, valid) => {
          if (valid) store.editLayer("Change settings", (layer) => ({ ...layer, params: values }), "params");
        }}
      />
    </div>
  );
}

function OutputSettings({ store, method }: { store: Store; method: Method }) {
  const { seed } = store.layer.value;
  const { output } = store.document.value;
  const schema = useMemo(() => {
    const { properties: { name: _name, ...properties } = {} } = outputSchema(method, output?.format);
    return { properties };
  }, [method, output?.format]);
  const values = useMemo(() => ({ ...(output as Params | undefined), ...(seed && { seed }) }), [output, seed]);
  const change = ({ seed = 0, ...output }: Params) => {
    const { place } = store;
    const withSeed = (layer: Layer): Layer => ({ ...layer, seed: Number(seed) });
    store.editDocument(
      "Change the output",
      (document) => changeLayer({ ...document, output: fitting(output) }, place, withSeed),
      "output",
    );
  };
  return <Form schema={schema} values={values} open={0} onChange={(next, valid) => valid && change(next)} />;
}

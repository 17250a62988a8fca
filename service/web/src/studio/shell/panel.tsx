/** The panel beside the stage: the method, its main inputs, all settings, output, and the button that submits. */

import { useMemo } from "preact/hooks";
import type { Method, Params, Section } from "../../api/schemas";
import { Inputs } from "../../forms/inputs";
import { MethodCards, Presets } from "../../forms/method-cards";
import { fitting, outputSchema } from "../../forms/output-form";
import { Form } from "../../forms/schema-form";
import { notify } from "../../ui/notices";
import type { Clusters } from "../clusters/clusters";
import { ClustersSection } from "../clusters/clusters-section";
import { addAsset, changeLayer, type Layer, type LayerPlace } from "../document/document";
import type { FilmFrame, Films } from "../films/films";
import { SubmitBar } from "../films/submit-bar";
import type { Foreground } from "../keys/foreground";
import type { PaintedKeys } from "../keys/keys";
import { KeysSection } from "../keys/keys-section";
import { MarksSection } from "../keys/marks-section";
import { usePresetPictures } from "../previews/preset-pictures";
import { RegionsSection } from "../regions/regions-section";
import type { Store } from "../state/store";
import { SaveStyle, StyleLibrary } from "../styles/style-library";
import { LayersSection } from "./layers-section";
import { Lesson } from "./lesson";
import { Variants } from "./variants";

export interface PanelProps {
  store: Store;
  films: Films;
  keys: PaintedKeys;
  clusters: Clusters;
  foreground: Foreground;
  /** Save everything; false if that failed. */
  saveAll(): Promise<boolean>;
  /** Make the present painting of the shown frame a key. */
  correct(): Promise<void>;
  /** Make a frame of a finished film a key. */
  take(frame: FilmFrame): Promise<void>;
  /** Find frames that are worth a key. */
  suggest(): Promise<void>;
}

export function Panel({ store, films, keys, clusters, foreground, saveAll, correct, take, suggest }: PanelProps) {
  const method = store.method.value;
  return (
    <aside class="panel designer-panel" aria-label="Settings">
      <div class="panel-body">
        <Lesson store={store} />
        <details class="group method-choice" open={!method}>
          <summary>
            <span>{method?.title ?? "Method"}</span>
          </summary>
          <MethodCards
            methods={store.methods}
            chosen={store.layer.value.method}
            onChoose={(name) => choose(store, name)}
          />
        </details>
        {method && (
          <MethodParts
            key={`${store.layer.value.id}-${method.name}`}
            store={store}
            films={films}
            keys={keys}
            clusters={clusters}
            foreground={foreground}
            solve={() => films.submit(saveAll).catch(notify)}
            method={method}
            saveAll={saveAll}
            correct={correct}
            take={take}
            suggest={suggest}
          />
        )}
      </div>
      <SubmitBar store={store} films={films} saveAll={saveAll} />
    </aside>
  );
}

interface MethodPartsProps extends PanelProps {
  method: Method;
  /** Paint the film. */
  solve(): void;
}

function MethodParts(props: MethodPartsProps) {
  const { store, method, saveAll } = props;
  return (
    <>
      <StyleLibrary store={store} method={method} />
      <LayerInputs store={store} method={method} />
      {method.studio.sections.map((section) => (
        <PartSection key={section.part} {...props} section={section} />
      ))}
      <AllSettings store={store} method={method} />
      <SaveStyle store={store} />
      <LayersSection store={store} />
      <Variants store={store} saveAll={saveAll} />
      <OutputSettings store={store} method={method} />
    </>
  );
}

/** The editor of one part of the layer. */
function PartSection({ section, ...props }: MethodPartsProps & { section: Section }) {
  const { store, keys, clusters, foreground, correct, take, suggest, solve } = props;
  const editors = {
    keys: () => (
      <KeysSection store={store} section={section} keys={keys} correct={correct} take={take} suggest={suggest} />
    ),
    marks: () => <MarksSection store={store} section={section} keys={keys} foreground={foreground} />,
    clusters: () => <ClustersSection store={store} section={section} clusters={clusters} solve={solve} />,
    regions: () => <RegionsSection store={store} section={section} />,
  };
  return editors[section.editor]();
}

function choose(store: Store, method: string): void {
  store.tool.value = "pan";
  store.editLayer("Change the method", (layer) => ({ ...layer, method, params: {} }));
}

/** The inputs that are plain files; painted keys, designs and masks are made on the stage instead. */
function LayerInputs({ store, method }: { store: Store; method: Method }) {
  const specs = method.inputs.filter(
    (spec) => spec.name !== "video" && (spec.required || ["image", "image-or-video"].includes(spec.kind)),
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
        search
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
    const { properties: { name: _name, ...properties } = {} } = outputSchema(method.artefacts, output?.format);
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

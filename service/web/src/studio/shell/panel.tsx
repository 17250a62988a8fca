/** The panel beside the stage: the method, its main inputs, all settings, output, and the button that submits. */

import { effect } from "@preact/signals";
import type { Method, Params } from "../../api/schemas";
import { createInputs } from "../../forms/inputs";
import { createMethodCards, createPresets } from "../../forms/method-cards";
import { outputSchema } from "../../forms/output-form";
import { createForm } from "../../forms/schema-form";
import { Embedded, type Part } from "../../ui/embedded";
import { notify } from "../../ui/notices";
import type { Clusters } from "../clusters/clusters";
import { ClustersSection } from "../clusters/clusters-section";
import { addAsset, changeLayer, type Layer, type LayerPlace } from "../document/document";
import type { FilmFrame, Films } from "../films/films";
import { SubmitBar } from "../films/submit-bar";
import type { Foreground } from "../keys/foreground";
import type { PaintedKeys } from "../keys/keys";
import { KeysSection } from "../keys/keys-section";
import { ScribblesSection } from "../keys/scribbles-section";
import { followPresets } from "../previews/preset-pictures";
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
          <Embedded key={`cards-${store.layer.value.id}-${store.layer.value.method}`} make={() => methodCards(store)} />
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
  const { store, keys, clusters, foreground, method, saveAll, correct, take, suggest, solve } = props;
  return (
    <>
      <StyleLibrary store={store} method={method} />
      <Embedded key={`inputs-${store.layer.value.id}-${inputsKey(store)}`} make={() => inputSlots(store, method)} />
      {method.name === "analogy" && (
        <KeysSection store={store} keys={keys} correct={correct} take={take} suggest={suggest} />
      )}
      {method.name === "patches" && <ScribblesSection store={store} keys={keys} foreground={foreground} />}
      {method.name === "patches" && <ClustersSection store={store} clusters={clusters} solve={solve} />}
      {method.name === "multistyle" && <RegionsSection store={store} />}
      <Embedded make={() => settings(store, method)} />
      <SaveStyle store={store} />
      <LayersSection store={store} />
      <Variants store={store} saveAll={saveAll} />
      <Embedded make={() => output(store, method)} />
    </>
  );
}

function methodCards(store: Store): Part {
  const choose = (method: string) => {
    store.tool.value = "pan";
    store.editLayer("Change the method", (layer) => ({ ...layer, method, params: {} }));
  };
  return { element: createMethodCards([...store.methods], store.layer.value.method, choose) };
}

/** The inputs that are plain files; painted keys, designs and masks are made on the stage instead. */
function inputSlots(store: Store, method: Method): Part {
  const specs = method.inputs.filter(
    (spec) => spec.name !== "video" && (spec.required || ["image", "image-or-video"].includes(spec.kind)),
  );
  const main = specs.filter((spec) => ["style_output", "reference"].includes(spec.name));
  const ordered = [...main, ...specs.filter((spec) => !main.includes(spec))];
  const assets = store.document.value.assets;
  const given = Object.fromEntries(
    Object.entries(store.layer.value.inputs ?? {}).map(([name, asset]) => [name, assets[asset]?.id ?? ""]),
  );
  const { place } = store; // another layer may be selected when an upload ends
  const slots = createInputs(ordered, given, () => setInputs(store, place, slots.values()));
  return slots;
}

/** Changes with the layer's inputs, so that the slots show what undo or the library has chosen. */
const inputsKey = (store: Store): string => JSON.stringify(store.layer.value.inputs ?? {});

function setInputs(store: Store, place: LayerPlace, values: Record<string, string>): void {
  store.editDocument("Change an input", (document) => {
    let next = document;
    const inputs: Record<string, string> = {};
    for (const [name, id] of Object.entries(values))
      [next, inputs[name]] = addAsset(next, name, { id }) as [typeof next, string];
    return changeLayer(next, place, (layer) => ({ ...layer, inputs }));
  });
}

/** Presets and the form of all parameters; undo and redo are written back into the form. */
function settings(store: Store, method: Method): Part {
  const form = createForm(method.params_schema, { onchange: changed, open: 0, search: true });
  const presets = createPresets(method.examples ?? [], (params) => {
    store.editLayer("Use a preset", (layer) => ({ ...layer, params }));
  });
  let written: Params | undefined;

  function changed(): void {
    if (!form.valid()) return;
    written = form.values();
    const params = written;
    store.editLayer("Change settings", (layer) => ({ ...layer, params }), "params");
  }

  const close = effect(() => {
    const { params = {} } = store.layer.value;
    presets.match(params);
    if (params === written) return;
    written = params;
    form.write(params);
  });
  const element = document.createElement("div");
  element.className = "all-settings";
  element.append(presets.element, form.element);
  const closePictures = followPresets(store, presets);
  return {
    element,
    close() {
      close();
      closePictures();
    },
  };
}

function output(store: Store, method: Method): Part {
  const schema = outputSchema(method.artefacts ?? []);
  const { name: _name, ...properties } = schema.properties ?? {};
  const form = createForm({ ...schema, properties }, { onchange: changed, open: 0 });
  const { output: present = {} } = store.document.value;
  form.write({ ...(present as Params), ...(store.layer.value.seed && { seed: store.layer.value.seed }) });

  function changed(): void {
    if (!form.valid()) return;
    const { seed = 0, ...rest } = form.values();
    const place = store.place;
    const withSeed = (layer: Layer): Layer => ({ ...layer, seed: Number(seed) });
    const change = (document: ReturnType<Store["document"]["peek"]>) =>
      changeLayer({ ...document, output: rest }, place, withSeed);
    store.editDocument("Change the output", change, "output");
  }

  return { element: form.element };
}

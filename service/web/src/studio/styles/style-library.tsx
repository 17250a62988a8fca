/** Paintings to choose from: the library's, those that the user's projects have, and styles that the user has saved. */

import { useEffect, useState } from "preact/hooks";
import type { Method, Params } from "../../api/schemas";
import { Icon, IconButton } from "../../ui/icons";
import { notify } from "../../ui/notices";
import { listProjects, readProject } from "../document/api";
import { addAsset, changeLayer, type Layer, type ProjectDocument } from "../document/document";
import type { Store } from "../state/store";
import { libraryPicture, listStyles, pictureOfAsset, type Style, useStyle } from "./styles";

const PROJECTS = 12;

/** Inputs of the methods that take a painting. */
const paintingInputs = (methods: readonly Method[]): string[] =>
  methods.flatMap(({ studio }) => (studio.painting ? [studio.painting] : []));

/** The same, and those for the pictures that the paintings show. */
const styleInputs = (methods: readonly Method[]): string[] => [
  ...paintingInputs(methods),
  ...methods.flatMap(({ studio }) => (studio.painting_source ? [studio.painting_source] : [])),
];

/** A style as a project's document keeps it, in `ui.styles`. */
export interface SavedStyle {
  title: string;
  method: string;
  params: Params;
  /** Asset names by input. */
  inputs: Record<string, string>;
}

const savedStyles = ({ ui }: ProjectDocument): SavedStyle[] =>
  Array.isArray(ui?.styles) ? (ui.styles as unknown as SavedStyle[]) : [];

/** The same with asset ids, which mean the same in every project; inputs without an asset are left out. */
export const portableStyles = (document: ProjectDocument): SavedStyle[] =>
  savedStyles(document).map((style) => ({
    ...style,
    inputs: Object.fromEntries(
      Object.entries(style.inputs).flatMap(([input, name]) => {
        const id = document.assets[name]?.id;
        return id ? [[input, id]] : [];
      }),
    ),
  }));

/** Asset ids of the paintings that a project's layers use, in inputs of these names. */
export function paintingsOf(document: ProjectDocument, inputs: readonly string[]): { id: string; title: string }[] {
  const layers = document.shots.flatMap((shot) => shot.layers);
  const names = layers.flatMap((layer) => inputs.map((input) => layer.inputs?.[input] ?? ""));
  return [...new Set(names)].flatMap((name) => {
    const ref = document.assets[name];
    return ref ? [{ id: ref.id, title: ref.title ?? document.name }] : [];
  });
}

/** The layer with other inputs in place of those of the names `replaced`, which hold a painting or its source. */
export function withPainting(
  document: ProjectDocument,
  place: { shot: string; layer: string },
  given: Record<string, { id: string; title: string }>,
  replaced: readonly string[],
): ProjectDocument {
  let next = document;
  const named: Record<string, string> = {};
  for (const [input, ref] of Object.entries(given)) {
    const [changed, name] = addAsset(next, input, ref);
    next = changed;
    named[input] = name;
  }
  return changeLayer(next, place, (layer) => {
    const kept = Object.entries(layer.inputs ?? {}).filter(([input]) => !replaced.includes(input));
    return { ...layer, inputs: { ...Object.fromEntries(kept), ...named } };
  });
}

interface Own {
  paintings: { id: string; title: string }[];
  saved: SavedStyle[];
}

export function StyleLibrary({ store, method }: { store: Store; method: Method }) {
  const { painting: input, painting_source: sourceInput } = method.studio;
  const replaced = styleInputs(store.methods);
  const [styles, setStyles] = useState<Style[]>([]);
  const own = useOwn(store);
  const [waiting, setWaiting] = useState("");
  useEffect(() => {
    if (input) listStyles().then(setStyles, () => setStyles([]));
  }, [input]);
  const chosen = store.document.value.assets[store.layer.value.inputs?.[input] ?? ""]?.id;
  const saved = [...portableStyles(store.document.value), ...own.saved];
  if (!input && !saved.length) return null;

  const use = async (style: Style) => {
    if (!input) return;
    const { place } = store;
    setWaiting(style.id);
    try {
      const { painting, source } = await useStyle(style.id);
      const given: Record<string, { id: string; title: string }> = { [input]: { id: painting.id, title: style.title } };
      if (source && sourceInput) given[sourceInput] = { id: source.id, title: `${style.title}, source` };
      store.editDocument("Choose a painting", (document) => withPainting(document, place, given, replaced));
    } catch (error) {
      notify(error);
    }
    setWaiting("");
  };
  const useOwnPainting = (painting: { id: string; title: string }) =>
    store.editDocument("Choose a painting", (document) =>
      withPainting(document, store.place, { [input]: painting }, replaced),
    );
  const useSaved = (style: SavedStyle) => {
    const place = store.place;
    store.editDocument("Use a saved style", (document) => {
      const refs = Object.entries(style.inputs).map(([name, id]) => [name, { id, title: style.title }]);
      const next = withPainting(document, place, Object.fromEntries(refs), replaced);
      return changeLayer(next, place, (layer): Layer => ({ ...layer, method: style.method, params: style.params }));
    });
  };
  return (
    <details class="group style-library" open={Boolean(input) && !chosen}>
      <summary>
        <span>Style library</span>
      </summary>
      {input && (
        <div class="library-cards" role="group" aria-label="Paintings of the library">
          {styles.map((style) => (
            <Card
              key={style.id}
              title={style.title}
              help={style.credit}
              picture={() => libraryPicture(style.id)}
              disabled={waiting === style.id}
              onChoose={() => use(style)}
            />
          ))}
        </div>
      )}
      {input && own.paintings.length > 0 && (
        <>
          <p class="library-title">Yours</p>
          <div class="library-cards" role="group" aria-label="Your paintings">
            {own.paintings.map((painting) => (
              <Card
                key={painting.id}
                title={painting.title}
                picture={() => pictureOfAsset(painting.id)}
                pressed={painting.id === chosen}
                onChoose={() => useOwnPainting(painting)}
              />
            ))}
          </div>
        </>
      )}
      {saved.length > 0 && (
        <ul class="region-list" aria-label="Saved styles">
          {saved.map((style, i) => (
            <li key={`${style.title}-${i}`}>
              <button type="button" class="layer-name" onClick={() => useSaved(style)}>
                {style.title}
              </button>
              {i < savedStyles(store.document.value).length && (
                <IconButton
                  name="trash"
                  label={`Remove the style ${style.title}`}
                  onClick={() => removeSaved(store, i)}
                />
              )}
            </li>
          ))}
        </ul>
      )}
    </details>
  );
}

/** Keep the layer's method, settings and painting under a name, for other projects too. */
export function SaveStyle({ store }: { store: Store }) {
  const [title, setTitle] = useState("");
  const save = (event: Event) => {
    event.preventDefault();
    const { method, params = {}, inputs = {} } = store.layer.value;
    const kept = Object.entries(inputs).filter(([input]) => styleInputs(store.methods).includes(input));
    const style: SavedStyle = { title: title.trim(), method, params, inputs: Object.fromEntries(kept) };
    store.editDocument("Save a style", (document) => ({
      ...document,
      ui: { ...document.ui, styles: [...savedStyles(document), style] as never },
    }));
    setTitle("");
  };
  return (
    <form class="save-style" onSubmit={save}>
      <input
        type="text"
        maxLength={80}
        required
        value={title}
        placeholder="Name of this style"
        aria-label="Name of the style to save"
        onInput={(event) => setTitle(event.currentTarget.value)}
      />
      <button type="submit" class="button small" disabled={!title.trim()}>
        <Icon name="plus" />
        Save style
      </button>
    </form>
  );
}

function removeSaved(store: Store, index: number): void {
  store.editDocument("Remove a saved style", (document) => ({
    ...document,
    ui: { ...document.ui, styles: savedStyles(document).filter((_, i) => i !== index) as never },
  }));
}

interface CardProps {
  title: string;
  help?: string;
  picture(): Promise<string>;
  pressed?: boolean;
  disabled?: boolean;
  onChoose(): void;
}

function Card({ title, help, picture, pressed, disabled, onChoose }: CardProps) {
  const [src, setSrc] = useState("");
  useEffect(() => {
    let current = true;
    picture().then(
      (url) => (current ? setSrc(url) : URL.revokeObjectURL(url)),
      () => {},
    );
    return () => {
      current = false;
    };
  }, []);
  useEffect(() => () => URL.revokeObjectURL(src), [src]);
  return (
    <button
      type="button"
      class="style-card"
      title={help || title}
      aria-pressed={pressed}
      disabled={disabled ?? false}
      onClick={onChoose}
    >
      {src ? <img src={src} alt="" /> : <span class="card-blank" />}
      <span>{title}</span>
    </button>
  );
}

/** Paintings and saved styles of the user's other projects, those changed last first. */
function useOwn(store: Store): Own {
  const [own, setOwn] = useState<Own>({ paintings: [], saved: [] });
  useEffect(() => {
    let current = true;
    const read = async () => {
      const inputs = paintingInputs(store.methods);
      const { items } = await listProjects(PROJECTS);
      const others = items.filter((project) => project.id !== store.projectId);
      const documents = (await Promise.all(others.map((project) => readProject(project.id)))).map(
        (one) => one.document,
      );
      const all = [store.document.peek(), ...documents].flatMap((one) => paintingsOf(one, inputs));
      const paintings = [...new Map(all.map((painting) => [painting.id, painting])).values()];
      if (current) setOwn({ paintings, saved: documents.flatMap(portableStyles) });
    };
    read().catch((error) => console.info("Impasto: no styles of other projects.", error));
    return () => {
      current = false;
    };
  }, []);
  return own;
}

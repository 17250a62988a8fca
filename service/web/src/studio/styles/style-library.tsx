/** Paintings to choose from: the library's, and those that the user's projects have; below them the looks. */

import { useEffect, useState } from "preact/hooks";
import type { Method } from "../../api/schemas";
import { notify } from "../../ui/notices";
import { listProjects, readProject } from "../document/api";
import { addAsset, changeLayer, type ProjectDocument } from "../document/document";
import { type Look, looksOf, portable } from "../document/looks";
import type { Store } from "../state/store";
import { Looks } from "./looks";
import { libraryPicture, listStyles, pictureOfAsset, type Style, useStyle } from "./styles";

const PROJECTS = 12;

/** Inputs of the methods that take a painting. */
const paintingInputs = (methods: readonly Method[]): string[] =>
  methods.flatMap(({ studio }) => (studio.painting ? [studio.painting] : []));

/** The same, and those for the pictures that the paintings show. */
export const styleInputs = (methods: readonly Method[]): string[] => [
  ...paintingInputs(methods),
  ...methods.flatMap(({ studio }) => (studio.painting_source ? [studio.painting_source] : [])),
];

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

/** The looks of a document with asset ids, which mean the same in every project. */
export const portableLooks = (document: ProjectDocument): Look[] =>
  looksOf(document).map((look) => portable(look, document));

interface Own {
  paintings: { id: string; title: string }[];
  looks: Look[];
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
  if (!input) return <Looks store={store} others={own.looks} />;

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
  return (
    <>
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
      </details>
      <Looks store={store} others={own.looks} />
    </>
  );
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

/** Paintings and looks of the user's other projects, those changed last first. */
function useOwn(store: Store): Own {
  const [own, setOwn] = useState<Own>({ paintings: [], looks: [] });
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
      if (current) setOwn({ paintings, looks: documents.flatMap(portableLooks) });
    };
    read().catch((error) => console.info("Impasto: no styles of other projects.", error));
    return () => {
      current = false;
    };
  }, []);
  return own;
}

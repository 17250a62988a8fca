/** Files of a layer of a shot: another video in place of the shot's, for example a pass, and a matte. */

import type { FileInput, Inputs } from "../../api/schemas";
import { Inputs as FileInputs } from "../../forms/inputs";
import { addAsset, changeShot, type Layer, type ProjectDocument } from "../document/document";
import type { Store } from "../state/store";

const FILES: FileInput[] = [
  {
    name: "source",
    kind: "video",
    required: false,
    title: "Own video",
    help: "Painted instead of the shot's video: same size, same frames. For example a pass, as a zip of frames.",
  },
  {
    name: "matte",
    kind: "video",
    required: false,
    title: "Matte",
    help: "White where the layer is seen: an image, a video, or a zip of frames.",
  },
];

/** The document with the layer's files: asset ids by "source" and "matte"; missing ones are taken away. */
export function withLayerFiles(
  document: ProjectDocument,
  place: { shot: string; layer: string },
  given: Inputs,
): ProjectDocument {
  let next = document;
  const files: Pick<Layer, "source" | "matte"> = {};
  for (const name of ["source", "matte"] as const) {
    const id = given[name];
    if (id) [next, files[name]] = addAsset(next, `${place.layer}-${name}`, { id });
  }
  return changeShot(next, place.shot, (shot) => ({
    ...shot,
    layers: shot.layers.map((layer) => {
      if (layer.id !== place.layer) return layer;
      const { source: _source, matte: _matte, ...rest } = layer;
      return { ...rest, ...files };
    }),
  }));
}

export function LayerFiles({ store, layer }: { store: Store; layer: Layer }) {
  const { assets } = store.document.value;
  const given = Object.fromEntries(
    (["source", "matte"] as const).flatMap((name) => {
      const id = assets[layer[name] ?? ""]?.id;
      return id ? [[name, id]] : [];
    }),
  );
  const place = { shot: store.shot.value.id, layer: layer.id };
  const change = (values: Inputs) =>
    store.editDocument("Change a layer's files", (document) => withLayerFiles(document, place, values));
  return <FileInputs specs={FILES} given={given} onChange={change} />;
}

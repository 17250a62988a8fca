/** Files of a layer of a shot: another video in place of the shot's, for example a pass, and a matte. */

import type { FileInput, Inputs } from "../../api/schemas";
import { Inputs as FileInputs } from "../../forms/inputs";
import { addAsset, changeShot, type Layer, type ProjectDocument } from "../document/document";
import { type LayerMatte, madeMatte } from "../keys/matte";
import { MATTE_TOOLS, type Store } from "../state/store";

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

/** The tool that makes the matte of clicks on the stage. */
export function MarkMatte({ store, matte, layer }: { store: Store; matte: LayerMatte; layer: Layer }) {
  const selected = store.layer.value.id === layer.id;
  const active = selected && MATTE_TOOLS.includes(store.tool.value);
  const made = madeMatte(layer);
  const [first, end] = store.reach.value;
  const short = made && (first < made.frames[0] || end > made.frames[1]);
  const toggle = () => {
    store.layerId.value = layer.id;
    store.tool.value = active ? "pan" : "matte";
  };
  return (
    <div class="matte-marks">
      <button type="button" class="button small" aria-pressed={active} onClick={toggle}>
        Mark the matte on the stage
      </button>
      {active && (
        <p class="hint">
          Click an object, or draw a box around it: the layer is seen there, through the shot. Click again to add, and
          with Alt to take away, from that frame on. Where that is not enough, paint: the brush adds, the eraser takes
          away.
        </p>
      )}
      {short && selected && (
        <>
          <p class="hint">
            It has been followed through frames {made.frames[0] + 1} to {made.frames[1]}; the shot has more, where the
            layer is not seen.
          </p>
          <button type="button" class="button small" onClick={() => matte.again()}>
            Follow it through the shot
          </button>
        </>
      )}
      {selected && matte.done.value !== null && <progress aria-label="Following the object" value={matte.done.value} />}
    </div>
  );
}

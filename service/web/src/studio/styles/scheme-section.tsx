/** The colour scheme of a layer, drawn over the hues of its shot. */

import { useEffect, useState } from "preact/hooks";
import type { Section } from "../../api/schemas";
import { type ColourScheme, schemeOf } from "../../forms/colour-scheme";
import { SchemeEditor } from "../../forms/scheme-editor";
import { pixelsOf } from "../../ui/palette";
import { withPart } from "../document/document";
import { thumbnail } from "../films/filmstrip";
import type { Store } from "../state/store";

/** Frames of the shot whose hues are counted. */
const FRAMES = 8;

export function SchemeSection({ store, section }: { store: Store; section: Section }) {
  const source = useSource(store);
  const given = store.layer.value.parts?.[section.part] as ColourScheme | undefined;
  const change = (scheme: ColourScheme | null, group: string) =>
    store.editLayer(
      scheme ? "Change the colour scheme" : "Remove the colour scheme",
      (layer) => withPart(layer, section.part, scheme ?? undefined),
      group && `${section.part}-${group}`,
    );
  return (
    <details class="group" open={Boolean(given)}>
      <summary>
        <span>{section.title}</span>
      </summary>
      <div class="group-body">
        <p class="field-help">{section.hint}</p>
        <SchemeEditor scheme={given ?? null} source={source} onChange={change} />
      </div>
    </details>
  );
}

/** The colour scheme of the video that the layer paints, from frames of the whole shot; null until they are there. */
function useSource(store: Store): ColourScheme | null {
  const [found, setFound] = useState<ColourScheme | null>(null);
  const { assets } = store.document.value;
  const asset = assets[store.layer.value.source ?? ""]?.id ?? store.asset.id;
  const [start, stop] = store.reach.value;
  useEffect(() => {
    const controller = new AbortController();
    const measure = async () => {
      const pictures: Uint8ClampedArray[] = [];
      const count = Math.min(FRAMES, stop - start);
      for (let i = 0; i < count; i++) {
        const url = await thumbnail(asset, start + Math.floor(((i + 0.5) * (stop - start)) / count), controller.signal);
        if (controller.signal.aborted) return;
        if (url) pictures.push(await pixelsAt(url));
      }
      if (!controller.signal.aborted) setFound(schemeOf(pictures));
    };
    measure().catch(() => {}); // without the video's hues, a scheme can be drawn all the same
    return () => controller.abort();
  }, [asset, start, stop]);
  return found;
}

async function pixelsAt(url: string): Promise<Uint8ClampedArray> {
  const picture = new Image();
  picture.src = url;
  await picture.decode();
  URL.revokeObjectURL(url);
  return pixelsOf(picture);
}

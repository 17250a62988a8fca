/** A picture beside the stage: a file, or a frame as it is painted. It is stored with the project; a click takes its colour. */

import { useEffect, useRef } from "preact/hooks";
import { paths, request } from "../../api/api";
import { Icon, IconButton } from "../../ui/icons";
import { notify } from "../../ui/notices";
import { hexOf } from "../../ui/palette";
import { upload } from "../../ui/upload";
import { addAsset } from "../document/document";
import type { PaintedKeys } from "../keys/keys";
import type { Store } from "../state/store";

/** Where the document has the name of the asset. */
const PLACE = "reference";

export function ReferenceTab({ store, keys }: { store: Store; keys: PaintedKeys }) {
  const { ui, assets } = store.document.value;
  const asset = assets[String(ui?.[PLACE] ?? "")]?.id;
  const set = (name: string | null) =>
    store.editDocument(name ? "Choose a reference" : "Remove the reference", (document) => {
      const { [PLACE]: _old, ...rest } = document.ui ?? {};
      return { ...document, ui: name ? { ...rest, [PLACE]: name } : rest };
    });
  const use = async (file: File) => {
    const { id } = await upload(file);
    store.editDocument("Choose a reference", (document) => {
      const [next, name] = addAsset(document, PLACE, { id });
      return { ...next, ui: { ...next.ui, [PLACE]: name } };
    });
  };
  const open = (event: Event) => {
    const input = event.currentTarget as HTMLInputElement;
    const file = input.files?.[0];
    input.value = "";
    if (file) use(file).catch(notify);
  };
  const useFrame = async () => {
    const frame = store.frame.peek();
    await use(new File([await keys.png(frame)], `reference-${frame}.png`, { type: "image/png" }));
  };
  return (
    <>
      {asset ? (
        <ReferencePicture store={store} asset={asset} />
      ) : (
        <p class="hint">A picture to look at while you paint. A click on it takes its colour.</p>
      )}
      <div class="actions">
        <label class="button small file-button">
          <Icon name="image" />
          Open a picture
          <input type="file" accept="image/*" aria-label="Open a reference picture" onChange={open} />
        </label>
        <button type="button" class="button small" onClick={() => useFrame().catch(notify)}>
          <Icon name="copy" />
          Keep this frame
        </button>
        {asset && <IconButton name="trash" label="Remove the reference" onClick={() => set(null)} />}
      </div>
    </>
  );
}

function ReferencePicture({ store, asset }: { store: Store; asset: string }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    const show = async () => {
      const picture = await createImageBitmap(await (await request(paths.content(asset))).blob());
      const element = canvas.current;
      if (element) {
        Object.assign(element, { width: picture.width, height: picture.height });
        element.getContext("2d", { willReadFrequently: true })?.drawImage(picture, 0, 0);
      }
      picture.close();
    };
    show().catch(notify);
  }, [asset]);
  const take = (event: MouseEvent) => {
    const element = canvas.current;
    const box = element?.getBoundingClientRect();
    if (!element || !box) return;
    const x = Math.floor(((event.clientX - box.left) / box.width) * element.width);
    const y = Math.floor(((event.clientY - box.top) / box.height) * element.height);
    const pixel = element.getContext("2d")?.getImageData(x, y, 1, 1).data;
    if (pixel) store.brush.value = { ...store.brush.peek(), color: hexOf(pixel.slice(0, 3)) };
  };
  return <canvas ref={canvas} class="reference-picture" role="img" aria-label="Reference" onClick={take} />;
}

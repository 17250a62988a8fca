/** How keys reach the studio: dropped anywhere on the page, pasted; and how a picture of another size is scaled. */

import { Problem } from "../../api/api";
import { askChoice } from "../../ui/dialogs";
import { notify } from "../../ui/notices";
import {
  changeLayer,
  type Framed,
  type ProjectDocument,
  picturesOf,
  removeAtFrame,
  withPart,
} from "../document/document";
import type { Size } from "../drawing/geometry";
import type { Store } from "../state/store";
import { type KeyActions, readCopied } from "./key-actions";
import { isPsd } from "./psd";
import { SCALINGS, type Scaling } from "./scaling";

/** On the clipboard, it stands for the key that was copied last. */
const MARK = "Key of Impasto";

export function askScaling(name: string, picture: Size, frame: Size): Promise<Scaling | null> {
  return askChoice<Scaling>({
    title: "The picture has another size",
    text: `“${name}” has ${picture.width} × ${picture.height} pixels, the video has ${frame.width} × ${frame.height}.`,
    choices: SCALINGS,
  });
}

/** The document without the key of the selected layer at a frame. */
export function withoutKey(store: Store, frame: number): ProjectDocument {
  const part = store.section("keys")?.part;
  const document = store.document.value;
  if (!part) return document;
  return changeLayer(document, store.place, (layer) =>
    withPart(layer, part, removeAtFrame(picturesOf<Framed>(layer, part), frame)),
  );
}

/** Take pictures that are dropped on the page or pasted as keys of the shown frame; returns what ends that. */
export function acceptKeys(store: Store, actions: KeyActions): () => void {
  const controller = new AbortController();
  const section = () => store.section("keys");

  const take = (file: File) => {
    const found = section();
    if (!found) {
      const title = store.method.value?.title ?? "The method";
      throw new Problem({ detail: `“${title}” takes no painted keys.`, remedy: "Choose a method that does." });
    }
    if (!file.type.startsWith("image/") && !isPsd(file))
      throw new Problem({
        detail: `“${file.name}” is not a picture.`,
        remedy: "Drop a PNG or a PSD here; add clips with the button of the film below.",
      });
    store.paint(found);
    return actions.import(store.frame.value, file);
  };

  const attempt = (work: () => Promise<void>) => {
    Promise.resolve().then(work).catch(notify);
  };

  document.addEventListener(
    "drop",
    (event) => {
      const [file] = event.dataTransfer?.files ?? [];
      if (!file || event.defaultPrevented) return;
      event.preventDefault();
      attempt(() => take(file));
    },
    controller,
  );
  document.addEventListener(
    "copy",
    (event) => {
      const found = section();
      const part = found && picturesOf(store.layer.value, found.part);
      const frame = store.frame.value;
      const open = found && store.history.value.present.pictures[store.pictureKey(frame, found)];
      if (isTyping(event) || !found || !(open || part?.some((key) => key.frame === frame))) return;
      event.preventDefault();
      event.clipboardData?.setData("text/plain", MARK);
      attempt(() => actions.copy(frame));
    },
    controller,
  );
  document.addEventListener(
    "paste",
    (event) => {
      const [file] = event.clipboardData?.files ?? [];
      const key = event.clipboardData?.getData("text/plain") === MARK && readCopied() !== null;
      if (isTyping(event) || !(file || key)) return;
      event.preventDefault();
      attempt(() => (file ? take(file) : actions.paste(store.frame.value)));
    },
    controller,
  );
  return () => controller.abort();
}

/** Whether text is written or selected, which the browser copies and pastes itself. */
function isTyping(event: ClipboardEvent): boolean {
  const target = event.target as Element | null;
  const field = target?.closest?.("input:not([type=range], [type=checkbox], [type=color]), textarea, select, dialog");
  return Boolean(field) || (event.type === "copy" && String(getSelection()) !== "");
}

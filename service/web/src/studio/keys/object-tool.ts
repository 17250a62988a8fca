/**
 * Fills an object with the brush's colour, or marks it: the service finds what is clicked, or in a box. With Alt, what has
 * been filled there is taken away.
 */

import { asProblem, isAbort } from "../../api/api";
import { notifyOf } from "../../ui/notices";
import { pictureOf, preview } from "../document/api";
import { createCanvas } from "../drawing/canvas";
import { addStroke, type FillStroke, type KeyPicture, type PictureLayer, runsOf } from "../drawing/strokes";
import type { Store } from "../state/store";
import type { StageTool } from "../state/tool";
import { type Box, createBoxTool } from "./box-tool";
import type { PaintedKeys } from "./keys";
import { isFullMask, MASK } from "./layer-edits";
import { LOCKED, type PaintTool } from "./paint-tool";

/** Longest side of the picture in which it is looked for: its outline is smoothed at the video's size. */
const SIDE_PX = 320;

export function createObjectTool(store: Store, keys: PaintedKeys, paint: PaintTool, redraw: () => void): StageTool {
  let running = new AbortController();

  async function find(box: Box, erase: boolean): Promise<void> {
    running.abort();
    running = new AbortController();
    const { signal } = running;
    const frame = store.frame.value;
    const key = store.pictureKey(frame);
    const color = store.brushColor;
    const body = { document: store.document.peek(), ...store.place, frame, box };
    const fill = (found: ImageBitmap) => {
      const picture = paint.present();
      const layer = picture && paint.target(picture);
      if (signal.aborted || !layer || store.pictureKey(store.frame.peek()) !== key) return;
      if (erase && layer.locked) return notifyOf(LOCKED);
      const runs = runsOf(inside(found, store.size));
      const how = { ...(erase && { erase }), ...(layer.locked && { locked: true }) };
      const stroke: FillStroke = { kind: "fill", color, opacity: 1, runs, ...how };
      const label = erase ? "Take an object away" : "Mark an object";
      if (runs.length) keys.edit(label, frame, addStroke(begun(picture, layer, erase), layer.id, stroke));
    };
    store.filling.value += 1;
    try {
      await preview({
        project: store.projectId,
        what: "object",
        channel: "object",
        body: { ...body, max_side_px: SIDE_PX },
        signal,
        async onrecord(record) {
          if (record.header.type === "mask") fill(await pictureOf(record));
        },
      });
    } catch (error) {
      if (!isAbort(error) && !signal.aborted) store.problem.value = asProblem(error).message;
    } finally {
      store.filling.value -= 1;
    }
  }

  return createBoxTool(store, (box, erase) => void find(box, erase), redraw);
}

/** The first object that is clicked for the mask of a key is all that the mask has: before, it is full. */
function begun(picture: KeyPicture, { id }: PictureLayer, erase: boolean): KeyPicture {
  const { mask } = picture;
  if (erase || id !== MASK || !mask || !isFullMask(mask)) return picture;
  return { ...picture, mask: { ...mask, strokes: [] } };
}

/** 1 where a mask is white, at another size. */
function inside(mask: ImageBitmap, size: { width: number; height: number }): Uint8Array {
  const [, context] = createCanvas(size);
  context.drawImage(mask, 0, 0, size.width, size.height);
  const { data } = context.getImageData(0, 0, size.width, size.height);
  return Uint8Array.from({ length: size.width * size.height }, (_, i) => ((data[4 * i] ?? 0) > 127 ? 1 : 0));
}

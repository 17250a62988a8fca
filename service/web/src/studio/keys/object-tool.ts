/** Fills an object with the brush's colour, or marks it: the service finds what is clicked, or in a box. */

import { asProblem, isAbort } from "../../api/api";
import { pictureOf, preview } from "../document/api";
import type { Point } from "../document/document";
import { createCanvas } from "../drawing/canvas";
import { addStroke, type FillStroke, runsOf } from "../drawing/strokes";
import type { Store } from "../state/store";
import type { PointerSample, StageTool } from "../state/tool";
import type { PaintedKeys } from "./keys";
import type { PaintTool } from "./paint-tool";

/** Longest side of the picture in which it is looked for: its outline is smoothed at the video's size. */
const SIDE_PX = 320;

export function createObjectTool(store: Store, keys: PaintedKeys, paint: PaintTool, redraw: () => void): StageTool {
  let box: [Point, Point] | null = null;
  let running = new AbortController();

  async function find([from, to]: [Point, Point]): Promise<void> {
    running.abort();
    running = new AbortController();
    const { signal } = running;
    const { width, height } = store.size;
    const share = ([x, y]: Point) => [x / width, y / height].map((value) => Math.min(1, Math.max(0, value)));
    const frame = store.frame.peek();
    const key = store.pictureKey(frame);
    const color = store.brushColor;
    const body = { document: store.document.peek(), ...store.place, frame, box: [...share(from), ...share(to)] };
    const fill = async (found: ImageBitmap) => {
      const picture = paint.present();
      const layer = picture && paint.target(picture);
      if (signal.aborted || !layer || store.pictureKey(store.frame.peek()) !== key) return;
      const runs = runsOf(inside(found, store.size));
      const stroke: FillStroke = { kind: "fill", color, opacity: 1, runs, ...(layer.locked && { locked: true }) };
      if (runs.length) keys.edit("Mark an object", frame, addStroke(picture, layer.id, stroke));
    };
    try {
      await preview({
        project: store.projectId,
        what: "object",
        channel: "object",
        body: { ...body, max_side_px: SIDE_PX },
        signal,
        async onrecord(record) {
          if (record.header.type === "mask") await fill(await pictureOf(record));
        },
      });
    } catch (error) {
      if (!isAbort(error) && !signal.aborted) store.problem.value = asProblem(error).message;
    }
  }

  return {
    cursor: "crosshair",
    down({ at }: PointerSample) {
      box = [at, at];
      return true;
    },
    move(samples) {
      const last = samples.at(-1);
      if (box && last) box = [box[0], last.at];
      redraw();
    },
    up() {
      if (box) find(box);
      box = null;
      redraw();
    },
    cancel() {
      box = null;
      redraw();
    },
    draw(context, px) {
      if (!box) return;
      const [[left, top], [right, bottom]] = box;
      for (const [color, width] of [
        ["#000", 3 * px],
        ["#fff", px],
      ] as const) {
        Object.assign(context, { strokeStyle: color, lineWidth: width });
        context.strokeRect(left, top, right - left, bottom - top);
      }
    },
  };
}

/** 1 where a mask is white, at another size. */
function inside(mask: ImageBitmap, size: { width: number; height: number }): Uint8Array {
  const [, context] = createCanvas(size);
  context.drawImage(mask, 0, 0, size.width, size.height);
  const { data } = context.getImageData(0, 0, size.width, size.height);
  return Uint8Array.from({ length: size.width * size.height }, (_, i) => ((data[4 * i] ?? 0) > 127 ? 1 : 0));
}

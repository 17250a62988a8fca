/** A tool with which an object is clicked, or a box is drawn around it. */

import type { Point } from "../document/document";
import type { Store } from "../state/store";
import type { PointerSample, StageTool } from "../state/tool";

/** Left, top, right, bottom, as shares of the frame's sides; without a size: a click. */
export type Box = [number, number, number, number];

/** `mark` is called with what was clicked or drawn, and whether the Alt key was down, which takes away. */
export function createBoxTool(store: Store, mark: (box: Box, erase: boolean) => void, redraw: () => void): StageTool {
  let drawn: { from: Point; to: Point; erase: boolean } | null = null;

  const share = ([x, y]: Point): Point => {
    const { width, height } = store.size;
    const within = (value: number) => Math.min(1, Math.max(0, value));
    return [within(x / width), within(y / height)];
  };

  return {
    cursor: "crosshair",
    down({ at, alt }: PointerSample) {
      drawn = { from: at, to: at, erase: alt };
      return true;
    },
    move(samples) {
      const last = samples.at(-1);
      if (drawn && last) drawn = { ...drawn, to: last.at };
      redraw();
    },
    up() {
      if (drawn) mark([...share(drawn.from), ...share(drawn.to)], drawn.erase);
      drawn = null;
      redraw();
    },
    cancel() {
      drawn = null;
      redraw();
    },
    draw(context, px) {
      if (!drawn) return;
      const [[left, top], [right, bottom]] = [drawn.from, drawn.to];
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

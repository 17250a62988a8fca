/** The outline of the brush under the pointer. It is an element over the stage, so that the stage need not be drawn again. */

import { effect } from "@preact/signals";
import { DRAWN_TOOLS, type Store } from "../state/store";

export interface BrushRing {
  /** The pointer is at this point of the stage, CSS px; null: it has left the stage. */
  move(at: [number, number] | null): void;
  /** Begin to change the size of the brush; false if the tool has none. */
  grab(at: [number, number]): boolean;
  /** A pixel to the right widens the brush by a pixel on each side. */
  drag(at: [number, number]): void;
  close(): void;
}

/** Rings below this width are not shown: the pointer is a cross. */
const LEAST_PX = 4;

export function createBrushRing(canvas: HTMLCanvasElement, store: Store): BrushRing {
  const ring = document.createElement("div");
  ring.className = "brush-ring";
  ring.hidden = true;
  canvas.after(ring);
  let place: [number, number] | null = null;
  /** Where a change of the size began, and the size there. */
  let grabbed: { at: [number, number]; size: number } | null = null;

  const draws = () => DRAWN_TOOLS.includes(store.tool.peek());

  function show(): void {
    const [x, y] = grabbed?.at ?? place ?? [0, 0];
    const width = store.brush.peek().size * store.view.peek().scale;
    ring.hidden = !place || !draws() || width < LEAST_PX;
    if (ring.hidden) return;
    const { roundness = 1, angle = 0, turn = "fixed" } = store.tip ?? {};
    const flat = turn === "fixed" ? roundness : 1;
    const { turn: turned = 0, mirrored } = store.view.peek();
    ring.style.width = `${width}px`;
    ring.style.height = `${width * flat}px`;
    const own = flat < 1 ? (mirrored ? -angle : angle) + turned : 0;
    ring.style.transform = `translate(${x}px, ${y}px) translate(-50%, -50%) rotate(${own}deg)`;
  }

  const stop = effect(() => {
    for (const each of [store.tool, store.brush, store.view, store.drawing.eraser, store.drawing.smudge]) each.value;
    show();
  });

  return {
    move(at) {
      place = at;
      show();
    },
    grab(at) {
      if (!draws()) return false;
      grabbed = { at, size: store.brush.peek().size };
      const end = () => {
        grabbed = null;
        show();
      };
      canvas.addEventListener("pointerup", end, { once: true });
      canvas.addEventListener("pointercancel", end, { once: true });
      return true;
    },
    drag(at) {
      if (!grabbed) return;
      const wider = (2 * (at[0] - grabbed.at[0])) / store.view.peek().scale;
      store.resizeBrush(grabbed.size + wider);
    },
    close() {
      stop();
      ring.remove();
    },
  };
}

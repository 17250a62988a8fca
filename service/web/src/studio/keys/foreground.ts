/**
 * What the service makes of marks, over the frame and the frames after it: a veil over the background that follows from
 * them, or the marks themselves where the film has them.
 */

import { effect, signal, untracked } from "@preact/signals";
import { asProblem, isAbort } from "../../api/api";
import type { Overlay } from "../../api/schemas";
import { pictureOf, preview } from "../document/api";
import { type ProjectDocument, picturesOf } from "../document/document";
import { createCanvas } from "../drawing/raster";
import type { Store } from "../state/store";

const REST_MS = 250;
/** Number of requested frames after the shown one. */
const AHEAD = 6;
/** Of the veil over the background. */
const VEIL_ALPHA = 0.6;
/** Of marks. */
const MARKS_ALPHA = 0.45;
const SEAM = "#d8401f";
/** Longest side of the frames in which they are moved, px. */
const MARKS_SIDE_PX = 512;

/** A dark veil over the background of a frame; transparent where the foreground is. */
export type Veil = HTMLCanvasElement;

export class Foreground {
  /** By frame. */
  readonly veils = signal<ReadonlyMap<number, Veil>>(new Map());
  readonly shown = signal(true);
  private known: readonly unknown[] = [];
  private timer = 0;
  private running = new AbortController();
  private readonly dispose: () => void;

  constructor(
    private readonly store: Store,
    private readonly redraw: () => void,
  ) {
    this.dispose = effect(() => this.follow());
  }

  close(): void {
    this.dispose();
    clearTimeout(this.timer);
    this.running.abort();
  }

  /** Ask for the foreground of the shown frame once the scribbles or the frame have rested. */
  private follow(): void {
    const { store } = this;
    const overlay = store.overlay("mask") ?? store.overlay("marks");
    const marks = overlay?.after.map((part) => picturesOf(store.layer.value, part)) ?? [];
    const frame = store.frame.value;
    const wanted = overlay && store.previews.value && this.shown.value && marks.some(({ length }) => length > 0);
    clearTimeout(this.timer);
    if (marks.some((one, i) => one !== this.known[i]) || !wanted) {
      this.known = marks;
      this.running.abort();
      this.veils.value = new Map();
    }
    if (wanted && !untracked(() => this.veils.value.has(frame)))
      this.timer = window.setTimeout(() => this.load(frame, overlay, store.document.peek()), REST_MS);
    untracked(this.redraw); // it may have been switched on or off
  }

  private async load(frame: number, overlay: Overlay, document: ProjectDocument): Promise<void> {
    const { store } = this;
    this.running.abort();
    this.running = new AbortController();
    const { signal: life } = this.running;
    const moved = overlay.kind === "marks";
    const body = { document, ...store.place, frame, around: AHEAD, ...(moved && { max_side_px: MARKS_SIDE_PX }) };
    const show = (at: number, mask: ImageBitmap): void => {
      if (life.aborted) return;
      this.veils.value = new Map(this.veils.value).set(at, moved ? thinned(mask) : veilOf(mask));
      this.redraw();
    };
    try {
      await preview({
        project: store.projectId,
        what: overlay.preview,
        channel: "foreground",
        body,
        signal: life,
        async onrecord(record) {
          if (record.header.type === "mask") show(record.header.frame, await pictureOf(record));
        },
      });
    } catch (error) {
      if (!isAbort(error) && !life.aborted) store.problem.value = asProblem(error).message;
    }
  }

  /** Draw the veil of the shown frame; the context is in pixels of the video. */
  draw(context: CanvasRenderingContext2D): void {
    const veil = this.veils.value.get(this.store.frame.value);
    const { width, height } = this.store.size;
    if (veil && this.shown.value) context.drawImage(veil, 0, 0, width, height);
  }
}

/** Marks through which the frame is seen, with a red seam: white ones are invisible on a bright frame otherwise. */
function thinned(marks: ImageBitmap): Veil {
  const [canvas, context] = createCanvas(marks);
  Object.assign(context, { shadowColor: SEAM, shadowBlur: marks.width / 128 });
  context.drawImage(marks, 0, 0);
  Object.assign(context, { shadowColor: "transparent", globalCompositeOperation: "destination-out" });
  context.globalAlpha = 1 - MARKS_ALPHA;
  context.drawImage(marks, 0, 0);
  return canvas;
}

/** `mask`: white where the foreground is. */
export function veilOf(mask: ImageBitmap): Veil {
  const [canvas, context] = createCanvas(mask);
  context.drawImage(mask, 0, 0);
  const image = context.getImageData(0, 0, mask.width, mask.height);
  const { data } = image;
  for (let i = 0; i < data.length; i += 4) {
    const background = 255 - (data[i] ?? 0);
    data.set([24, 18, 40, Math.round(VEIL_ALPHA * background)], i);
  }
  context.putImageData(image, 0, 0);
  return canvas;
}

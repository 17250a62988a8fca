/**
 * Where the painting flickers against its source: a heat map of the shown frame over its painting, and the frames with the
 * most flicker. Of the newest film, or of previews while there is none.
 */

import { computed, effect, signal } from "@preact/signals";
import { asProblem, isAbort } from "../../api/api";
import { pictureOf, preview } from "../document/api";
import type { FlickerHeader } from "../document/records";
import { createCanvas } from "../drawing/raster";
import { PAINT_TOOLS, type Store } from "../state/store";
import { filmHas } from "./films";

const SIDE_PX = 640;
const REST_MS = 250;
/** Frames of a shot without a film that are measured at once: they are painted for it. */
const AROUND = 12;
const WORST = 3;
const MOST_ALPHA = 0.9;

export interface Measured {
  /** As in the quality report: 1 = as steady as the source; null: the first frame of a shot. */
  flicker: number | null;
  /** Root mean square of the warped difference, 0..1. */
  error: number | null;
}

interface Heat extends Measured {
  frame: number;
  painted: ImageBitmap | null;
  map: HTMLCanvasElement | null;
}

/** The frames with the largest error, in the order of time. */
export function worstFrames(measured: ReadonlyMap<number, Measured>, most = WORST): number[] {
  const known = [...measured].filter(([, { error }]) => (error ?? 0) > 0);
  known.sort(([a, { error: x }], [b, { error: y }]) => (y ?? 0) - (x ?? 0) || a - b);
  return known
    .slice(0, most)
    .map(([frame]) => frame)
    .sort((a, b) => a - b);
}

/** Red, green, blue and opacity, 0..255, of a value 0..255: yellow, then red; transparent without flicker. */
export function heatColour(value: number): [number, number, number, number] {
  const share = value / 255;
  return [255, Math.round(220 * (1 - share)), 0, Math.round(255 * MOST_ALPHA * Math.sqrt(share))];
}

export class Flicker {
  readonly heat = signal<Heat | null>(null);
  readonly measured = signal<ReadonlyMap<number, Measured>>(new Map());
  readonly measuring = signal(false);
  /** Whether previews are measured although there is a film. */
  readonly ofPreviews = signal(false);
  /** The film that is measured; null: previews are. */
  readonly film = computed(() => (this.ofPreviews.value ? null : this.store.film.value));
  private readonly disposers: (() => void)[];
  private map = new AbortController();
  private figures = new AbortController();
  private timer = 0;

  constructor(
    private readonly store: Store,
    private readonly redraw: () => void,
  ) {
    this.disposers = [effect(() => this.follow()), effect(() => this.forget())];
  }

  close(): void {
    for (const dispose of this.disposers) dispose();
    clearTimeout(this.timer);
    this.map.abort();
    this.figures.abort();
  }

  /** Show the heat map of the frame that is shown, once it has rested. */
  private follow(): void {
    const { store } = this;
    const shown = store.stageView.value === "flicker" && store.previews.value;
    const [frame, document, film] = [store.frame.value, store.document.value, this.film.value];
    clearTimeout(this.timer);
    this.map.abort();
    if (shown) this.timer = window.setTimeout(() => this.load(frame, document, film?.id), REST_MS);
  }

  /** Figures of another film, or of previews before a change, are no longer true. */
  private forget(): void {
    if (this.film.value === null) this.store.document.value;
    this.figures.abort();
    this.measured.value = new Map();
    this.heat.value = null;
  }

  private async load(frame: number, document: object, film: string | undefined): Promise<void> {
    this.map = new AbortController();
    const { signal: life } = this.map;
    let painted: ImageBitmap | null = null;
    const body = { ...this.body(document), frame, film: this.covered(frame) ? film : undefined };
    await this.run("flicker", body, life, async (record) => {
      const { header } = record;
      if (header.type === "frame") painted = await pictureOf(record);
      if (header.type !== "flicker") return;
      const map = header.bytes ? heatMap(await pictureOf(record)) : null;
      if (life.aborted) return;
      this.heat.value = { frame, painted, map, ...figures(header) };
      this.redraw();
    });
  }

  /** Measure the film, or previews around the shown frame, and find the frames with the most flicker. */
  async measure(): Promise<void> {
    const { store } = this;
    this.figures.abort();
    this.figures = new AbortController();
    const { signal: life } = this.figures;
    const film = this.film.value;
    const at = store.frame.value;
    const around = [Math.max(0, at - AROUND), Math.min(store.frames, at + AROUND)];
    const frames = film ? (film.request.frames ?? [0, store.frames]) : around;
    this.measured.value = new Map();
    this.measuring.value = true;
    const body = { ...this.body(store.document.value), frames, film: film?.id, max_side_px: SIDE_PX / 2 };
    await this.run("flicker-figures", body, life, ({ header }) => {
      if (header.type !== "flicker" || life.aborted) return;
      this.measured.value = new Map(this.measured.value).set(header.frame, figures(header));
    });
    if (!life.aborted) this.measuring.value = false;
  }

  private covered(frame: number): boolean {
    return this.film.value !== null && filmHas(this.store, frame);
  }

  private body(document: object): object {
    return { document, shot: this.store.shot.peek().id, max_side_px: SIDE_PX };
  }

  private async run(
    channel: string,
    body: object,
    life: AbortSignal,
    onrecord: (record: Parameters<Parameters<typeof preview>[0]["onrecord"]>[0]) => void | Promise<void>,
  ): Promise<void> {
    let last: Promise<void> = Promise.resolve();
    const inOrder = (record: Parameters<typeof onrecord>[0]) => {
      last = last.then(() => onrecord(record));
    };
    const options = { project: this.store.projectId, what: "flicker" as const, channel, body, signal: life };
    try {
      await preview({ ...options, onrecord: inOrder });
      await last;
    } catch (error) {
      if (isAbort(error) || life.aborted) return;
      this.store.problem.value = asProblem(error).message;
    }
  }

  /** Draw painting and heat map of the shown frame; the context is in pixels of the video. */
  draw(context: CanvasRenderingContext2D): void {
    const heat = this.heat.value;
    const { stageView, tool, frame, size } = this.store;
    const shown = stageView.value === "flicker" && !PAINT_TOOLS.includes(tool.value);
    if (!shown || heat?.frame !== frame.value) return;
    const { width, height } = size;
    if (heat.painted) context.drawImage(heat.painted, 0, 0, width, height);
    if (heat.map) context.drawImage(heat.map, 0, 0, width, height);
  }
}

const figures = ({ flicker, error }: FlickerHeader): Measured => ({ flicker, error });

/** The gray map as colours with opacity. */
function heatMap(gray: ImageBitmap): HTMLCanvasElement {
  const [canvas, context] = createCanvas(gray);
  context.drawImage(gray, 0, 0);
  const image = context.getImageData(0, 0, gray.width, gray.height);
  const colours = Array.from({ length: 256 }, (_, value) => heatColour(value));
  for (let i = 0; i < image.data.length; i += 4) image.data.set(colours[image.data[i] ?? 0] ?? [0, 0, 0, 0], i);
  context.putImageData(image, 0, 0);
  return canvas;
}

/** Something of the shown frame as the film has it, asked for while it is wanted, once the layer and the frame have rested. */

import { effect, type Signal, signal, untracked } from "@preact/signals";
import { asProblem, isAbort } from "../../api/api";
import { type PreviewOptions, preview } from "../document/api";
import type { Design } from "../document/design";
import type { Layer } from "../document/document";
import type { PreviewRecord } from "../document/records";
import type { Store } from "../state/store";

/** Shorter than that of the painting, which has to wait for the same tasks of the film. */
const REST_MS = 50;
/** As the stage's pictures: what the service computes for one is there for the other. */
export const FILM_SIDE_PX = 960;

export interface FilmViewOptions<Value> {
  what: PreviewOptions["what"];
  channel: string;
  /** Besides the frame. */
  options: object;
  /** Whether it is wanted now. */
  wanted(): boolean;
  /** The members of the design on which it depends. */
  of: readonly (keyof Design)[];
  /** What a record says; undefined: nothing. */
  read(record: PreviewRecord): Promise<Value> | undefined;
}

export interface Shown<Value> {
  frame: number;
  layer: Layer;
  value: Value;
}

export class FilmView<Value> {
  readonly shown: Signal<Shown<Value> | null> = signal(null);
  /** Why there is none. */
  readonly problem = signal("");
  private timer = 0;
  private running = new AbortController();
  private readonly dispose: () => void;

  constructor(
    private readonly store: Store,
    private readonly options: FilmViewOptions<Value>,
    private readonly redraw: () => void,
  ) {
    this.dispose = effect(() => this.follow());
  }

  /** What is shown, if it is of the frame as it is now. */
  get present(): Value | undefined {
    const shown = this.shown.value;
    const { frame, layer } = this.store;
    if (!shown || shown.frame !== frame.value) return undefined;
    const [before, now] = [this.basis(shown.layer), this.basis(layer.value)];
    return before.every((one, i) => one === now[i]) ? shown.value : undefined;
  }

  /** The parts of a layer on which it depends; a change makes new ones. */
  private basis(layer: Layer): unknown[] {
    const design = layer.parts?.[this.store.section("regions", layer)?.part ?? ""] as Design | undefined;
    const { id, method, params, seed, inputs } = layer;
    return [id, method, params, seed, inputs, ...this.options.of.map((name) => design?.[name])];
  }

  private follow(): void {
    const { store } = this;
    const [frame, layer] = [store.frame.value, store.layer.value];
    const wanted = store.previews.value && this.options.wanted();
    clearTimeout(this.timer);
    this.running.abort();
    if (wanted && !untracked(() => this.present))
      this.timer = window.setTimeout(() => this.load(frame, layer), REST_MS);
  }

  private async load(frame: number, layer: Layer): Promise<void> {
    const { store, options } = this;
    this.running = new AbortController();
    const { signal: life } = this.running;
    const show = (value: Value): void => {
      if (life.aborted) return;
      this.shown.value = { frame, layer, value };
      this.redraw();
    };
    const body = {
      document: store.document.peek(),
      ...store.place,
      frame,
      max_side_px: FILM_SIDE_PX,
      ...options.options,
    };
    try {
      this.problem.value = "";
      await preview({
        project: store.projectId,
        what: options.what,
        channel: options.channel,
        body,
        signal: life,
        onrecord: (record) => void options.read(record)?.then(show),
      });
    } catch (error) {
      if (!isAbort(error) && !life.aborted) this.problem.value = asProblem(error).message;
    }
  }

  close(): void {
    this.dispose();
    clearTimeout(this.timer);
    this.running.abort();
  }
}

/**
 * The matte of a layer, made of clicks and strokes on the stage: the service follows the objects through the shot, and what
 * it finds becomes the layer's file. The stage shows that file, and the film uses it.
 */

import { effect, signal, untracked } from "@preact/signals";
import { encode } from "fast-png";
import { isAbort, paths, request } from "../../api/api";
import { percent } from "../../ui/format";
import { notify, notifyOf } from "../../ui/notices";
import { upload } from "../../ui/upload";
import { preview } from "../document/api";
import { addAsset, changeLayer, type Layer, layerOf, shotOf } from "../document/document";
import { MATTE_TOOLS, type Store } from "../state/store";
import type { Span } from "../state/timeline";
import type { StageTool } from "../state/tool";
import { type Box, createBoxTool } from "./box-tool";
import { type Veil, veilOf } from "./foreground";
import { createMatteBrush, type MatteStroke } from "./matte-brush";

const SIDE_PX = 2048;
const MEMBER = "matte";
/** Stands for the id of a file while objects are followed. */
const FOLLOWED = "followed";
const NOTHING_YET = {
  title: "There is no matte to take away from",
  message: "A matte begins with what it shows: a click on an object, a box around it, or a stroke of the brush.",
  remedy: "Mark something first. A file that is the layer's matte cannot be changed here.",
};

/** A click on an object or a box around it, or a painted stroke. */
type MatteMark = { frame: number; erase: boolean } & ({ box: Box } | { stroke: MatteStroke });

/** How a layer's matte was made; in `Layer.ui`. */
interface MadeMatte {
  /** Name of its asset: another file has taken its place if the layer has another one. */
  asset: string;
  marks: readonly MatteMark[];
  /** The frames through which the objects were followed. It is black in the others. */
  frames: Span;
}

/** How the layer's matte was made; undefined: it has none, or a file of the user. */
export function madeMatte(layer: Layer): MadeMatte | undefined {
  const made = layer.ui?.[MEMBER] as MadeMatte | undefined;
  return made && made.asset === layer.matte ? made : undefined;
}

export class LayerMatte {
  readonly tools: Record<"matte" | "matteBrush" | "matteEraser", StageTool>;
  /** Share of the frames through which the objects have been followed; null: nothing is being followed. */
  readonly done = signal<number | null>(null);
  /** Darkens a frame outside the matte; `asset` is that of the matte, or `FOLLOWED`. */
  private readonly veil = signal<{ asset: string; frame: number; veil: Veil } | null>(null);
  /** Masks of what is being followed, as PNG, by frame. */
  private readonly found = signal<ReadonlyMap<number, Uint8Array>>(new Map());
  private running = new AbortController();
  private loading = new AbortController();
  /** Marks that are not in the document yet, and the state on which they build. */
  private pending: { layer: Layer; marks: readonly MatteMark[] } | null = null;
  private readonly dispose: () => void;

  constructor(
    private readonly store: Store,
    private readonly redraw: () => void,
  ) {
    const brush = (erase: boolean) =>
      createMatteBrush(store, erase, (stroke, away) => this.mark({ stroke }, away), redraw);
    this.tools = {
      matte: createBoxTool(store, (box, erase) => this.mark({ box }, erase), redraw),
      matteBrush: brush(false),
      matteEraser: brush(true),
    };
    this.dispose = effect(() => this.follow());
  }

  close(): void {
    this.dispose();
    this.running.abort();
    this.loading.abort();
  }

  /** Follow the objects again, through the frames that the shot has now. */
  again(): void {
    this.make(madeMatte(this.store.layer.value)?.marks ?? []);
  }

  private mark(what: { box: Box } | { stroke: MatteStroke }, erase: boolean): void {
    const { store } = this;
    const layer = store.layer.value;
    const before = this.pending?.layer === layer ? this.pending.marks : (madeMatte(layer)?.marks ?? []);
    if (erase && !before.length) notifyOf(NOTHING_YET);
    else this.make([...before, { frame: store.frame.value, erase, ...what }]);
  }

  private async make(marks: readonly MatteMark[]): Promise<void> {
    const { store } = this;
    this.running.abort();
    this.running = new AbortController();
    const { signal: life } = this.running;
    const { place } = store;
    const [layer, frames] = [store.layer.value, store.reach.value];
    this.pending = { layer, marks };
    this.done.value = 0;
    this.found.value = new Map();
    store.filling.value += 1;
    try {
      const masks = await this.masks(marks, frames, life);
      const file = new File([await zipped(masks, store)], `${place.layer}-matte.zip`, { type: "application/zip" });
      const { id } = await upload(file, { signal: life });
      if (life.aborted || layerOf(shotOf(store.document.value, place.shot), place.layer) !== layer) return;
      store.editDocument("Mark the matte", (document) => {
        const [next, asset] = addAsset(document, `${place.layer}-matte`, { id });
        const made: MadeMatte = { asset, marks, frames };
        return changeLayer(next, place, (one) => ({ ...one, matte: asset, ui: { ...one.ui, [MEMBER]: made } }));
      });
    } catch (error) {
      if (!isAbort(error) && !life.aborted) notify(error);
    } finally {
      store.filling.value -= 1;
      if (!life.aborted) {
        this.pending = null;
        this.done.value = null;
        this.found.value = new Map();
        store.busy.value = "";
      }
    }
  }

  /** The masks of frames [first, end), as PNG, by frame. */
  private async masks(
    marks: readonly MatteMark[],
    frames: Span,
    life: AbortSignal,
  ): Promise<ReadonlyMap<number, Uint8Array>> {
    const { store } = this;
    await preview({
      project: store.projectId,
      what: "matte",
      channel: "matte",
      body: { document: store.document.peek(), ...store.place, marks, frames, frame: store.frame.peek() },
      signal: life,
      onrecord: ({ header, payload }) => {
        if (header.type === "mask") this.found.value = new Map(this.found.value).set(header.frame, payload);
        if (header.type !== "progress") return;
        this.done.value = header.done;
        store.busy.value = `${header.note}: ${percent(header.done)}`;
      },
    });
    return this.found.peek();
  }

  // -- what the stage shows

  /** Load what the stage shows of the shown frame: of the file, or of what is being followed, which takes its place. */
  private follow(): void {
    const { store } = this;
    const frame = store.frame.value;
    const [asset, png] = [this.shown(), this.found.value.get(frame)];
    const shown = untracked(() => this.veil.value);
    if (!MATTE_TOOLS.includes(store.tool.value) || (shown?.asset === asset && shown.frame === frame)) return;
    this.loading.abort();
    this.loading = new AbortController();
    const { signal: life } = this.loading;
    if (asset) this.load(asset, frame, png, life).catch((error) => isAbort(error) || notify(error));
  }

  /** What the stage shows: the id of the matte's file, or what is being followed; empty: nothing. */
  private shown(): string {
    const { store, found } = this;
    if (found.value.has(store.frame.value)) return FOLLOWED;
    return store.document.value.assets[store.layer.value.matte ?? ""]?.id ?? "";
  }

  private async load(asset: string, frame: number, png: Uint8Array | undefined, life: AbortSignal): Promise<void> {
    const still = png
      ? new Blob([png as Uint8Array<ArrayBuffer>])
      : await (await request(paths.frame(asset, frame, SIDE_PX), { signal: life })).blob();
    const veil = veilOf(await createImageBitmap(still));
    if (life.aborted) return;
    this.veil.value = { asset, frame, veil };
    this.redraw();
  }

  /** Darken what is outside the matte of the shown frame; the context is in pixels of the video. */
  draw(context: CanvasRenderingContext2D): void {
    const { store } = this;
    const shown = this.veil.value;
    if (!MATTE_TOOLS.includes(store.tool.value) || shown?.frame !== store.frame.value) return;
    if (shown.asset !== this.shown()) return;
    context.drawImage(shown.veil, 0, 0, store.size.width, store.size.height);
  }
}

/** A zip of a gray PNG for every frame of the video, black where there is no mask. */
async function zipped(masks: ReadonlyMap<number, Uint8Array>, { frames, size }: Store): Promise<Blob> {
  const { zip } = await import("fflate");
  const black = encode({ ...size, data: new Uint8Array(size.width * size.height), depth: 8, channels: 1 });
  const files: Record<string, Uint8Array> = {};
  for (let frame = 0; frame < frames; frame++)
    files[`${String(frame).padStart(7, "0")}.png`] = masks.get(frame) ?? black;
  const packed = await new Promise<Uint8Array<ArrayBuffer>>((done, fail) =>
    zip(files, { level: 0 }, (error, data) => (error ? fail(error) : done(data as Uint8Array<ArrayBuffer>))),
  );
  return new Blob([packed]);
}

/**
 * The matte of a layer, made of clicks on the stage: the service follows the clicked objects through the shot, and what it
 * finds becomes the layer's file. The stage shows that file, and the film uses it.
 */

import { effect, signal, untracked } from "@preact/signals";
import { encode } from "fast-png";
import { isAbort, paths, request } from "../../api/api";
import { percent } from "../../ui/format";
import { notify } from "../../ui/notices";
import { upload } from "../../ui/upload";
import { preview } from "../document/api";
import { addAsset, changeLayer, type Layer, layerOf, shotOf } from "../document/document";
import type { Store } from "../state/store";
import type { Span } from "../state/timeline";
import type { StageTool } from "../state/tool";
import { type Box, createBoxTool } from "./box-tool";
import { type Veil, veilOf } from "./foreground";

const SIDE_PX = 2048;
const MEMBER = "matte";

interface MatteMark {
  frame: number;
  box: Box;
  erase: boolean;
}

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
  readonly tool: StageTool;
  /** Share of the frames through which the objects have been followed; null: nothing is being followed. */
  readonly done = signal<number | null>(null);
  private readonly veil = signal<{ asset: string; frame: number; veil: Veil } | null>(null);
  private running = new AbortController();
  private loading = new AbortController();
  /** Marks that are not in the document yet, and the state on which they build. */
  private pending: { layer: Layer; marks: readonly MatteMark[] } | null = null;
  private readonly dispose: () => void;

  constructor(
    private readonly store: Store,
    private readonly redraw: () => void,
  ) {
    this.tool = createBoxTool(store, (box, erase) => this.mark(box, erase), redraw);
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

  private mark(box: Box, erase: boolean): void {
    const { store } = this;
    const layer = store.layer.value;
    const before = this.pending?.layer === layer ? this.pending.marks : (madeMatte(layer)?.marks ?? []);
    if (erase && !before.length) return;
    this.make([...before, { frame: store.frame.value, box, erase }]);
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
        store.busy.value = "";
      }
    }
  }

  /** The masks of frames [first, end), as PNG, by frame. */
  private async masks(marks: readonly MatteMark[], frames: Span, life: AbortSignal): Promise<Map<number, Uint8Array>> {
    const { store } = this;
    const found = new Map<number, Uint8Array>();
    await preview({
      project: store.projectId,
      what: "matte",
      channel: "matte",
      body: { document: store.document.peek(), ...store.place, marks, frames },
      signal: life,
      onrecord: ({ header, payload }) => {
        if (header.type === "mask") found.set(header.frame, payload);
        if (header.type !== "progress") return;
        this.done.value = header.done;
        store.busy.value = `${header.note}: ${percent(header.done)}`;
      },
    });
    return found;
  }

  // -- what the stage shows

  private follow(): void {
    const { store } = this;
    const [frame, name] = [store.frame.value, store.layer.value.matte ?? ""];
    const asset = store.document.value.assets[name]?.id ?? "";
    const shown = untracked(() => this.veil.value);
    if (store.tool.value !== "matte" || (shown?.asset === asset && shown.frame === frame)) return;
    this.loading.abort();
    this.loading = new AbortController();
    if (asset) this.load(asset, frame, this.loading.signal).catch((error) => isAbort(error) || notify(error));
  }

  private async load(asset: string, frame: number, life: AbortSignal): Promise<void> {
    const still = asset ? paths.frame(asset, frame, SIDE_PX) : "";
    const answer = await request(still, { signal: life });
    const veil = veilOf(await createImageBitmap(await answer.blob()));
    if (life.aborted) return;
    this.veil.value = { asset, frame, veil };
    this.redraw();
  }

  /** Darken what is outside the matte of the shown frame; the context is in pixels of the video. */
  draw(context: CanvasRenderingContext2D): void {
    const { store } = this;
    const shown = this.veil.value;
    const asset = store.document.value.assets[store.layer.value.matte ?? ""]?.id;
    if (store.tool.value !== "matte" || !shown || shown.asset !== asset || shown.frame !== store.frame.value) return;
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

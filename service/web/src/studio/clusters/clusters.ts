/**
 * The clusters of a layer: label maps and their uncertainty as the newest film of the shot has them, or as the service
 * finds them before a film, and the maps that the user has corrected since.
 */

import { computed, effect, signal } from "@preact/signals";
import * as api from "../../api/api";
import type { Job, Overlay, Page } from "../../api/schemas";
import { upload } from "../../ui/upload";
import { type ProjectJob, preview, projectJobs } from "../document/api";
import {
  addAsset,
  changeLayer,
  type LabelCorrection,
  type Layer,
  type LayerPlace,
  layerOf,
  picturesOf,
  putAtFrame,
  removeAtFrame,
  shotOf,
  stemOf,
  withPart,
} from "../document/document";
import { createCanvas } from "../drawing/raster";
import type { Store } from "../state/store";
import { colourOf, enlarged, solvedAround } from "./label-edits";
import { decodeLabels, encodeLabels, type LabelMap } from "./label-png";

const OVERLAY_ALPHA = 0.55;

/** Uncertainty of each label of a frame, 0..1, by the label's digits. */
export type FrameUncertainty = Readonly<Record<string, number>>;

export class Clusters {
  /** The film whose clusters are shown; null: none yet. */
  readonly film = signal<Job | null>(null);
  /** Label maps as PNG by frame, found without a film; they are newer than the film's. */
  readonly found = signal<ReadonlyMap<number, Uint8Array<ArrayBuffer>>>(new Map());
  readonly searching = signal(false);
  readonly available = computed(() => this.film.value !== null || this.found.value.size > 0);
  readonly shown = signal(false);
  /** The map of the shown frame. */
  readonly map = signal<(LabelMap & { frame: number }) | null>(null);
  readonly uncertainty = signal<ReadonlyMap<number, FrameUncertainty>>(new Map());
  /** The label under the brush. */
  readonly label = signal(1);
  private readonly known = new Map<string, LabelMap>();
  private overlay: { map: LabelMap; canvas: HTMLCanvasElement } | null = null;
  private pending: Promise<void> = Promise.resolve();
  private waiting = 0;
  private search = new AbortController();
  private ofFilm: ReadonlyMap<number, FrameUncertainty> = new Map();
  private readonly disposers: (() => void)[];
  private readonly life = new AbortController();

  constructor(
    private readonly store: Store,
    private readonly onproblem: (error: unknown) => void,
    private readonly redraw: () => void,
  ) {
    const show = effect(() => {
      if (!store.overlay("labels")) return;
      const frame = store.frame.value;
      const found = this.found.value.has(frame) || this.film.value !== null;
      if (this.shown.value && found) this.load(frame, this.correction(frame)).catch((error) => this.failed(error));
    });
    const basis = computed(() => clusterBasis(store.layer.value, store.overlay("labels")));
    const forget = effect(() => {
      basis.value;
      this.forget();
    });
    const follow = effect(() => {
      store.film.value; // a film that has just ended
      if (store.overlay("labels", store.layer.peek())) this.find();
    });
    this.disposers = [show, forget, follow];
  }

  close(): void {
    for (const dispose of this.disposers) dispose();
    this.search.abort();
    this.life.abort();
  }

  private failed(error: unknown): void {
    if (!api.isAbort(error)) this.onproblem(error);
  }

  /** Look for the newest film with clusters. */
  async find(): Promise<void> {
    const { signal: life } = this.life;
    try {
      const shot = this.store.shot.peek().id;
      const { artefact = "", uncertainty = "" } = this.store.overlay("labels", this.store.layer.peek()) ?? {};
      const made = (await projectJobs(this.store.projectId)).filter((one) =>
        usable(one, shot, [artefact, uncertainty]),
      );
      const film = (artefact && made[0]?.job) || null;
      if (film && uncertainty) this.ofFilm = await readUncertainty(film, uncertainty, life);
      if (!this.found.peek().size) this.uncertainty.value = this.ofFilm;
      this.film.value = film;
    } catch (error) {
      this.failed(error);
    }
  }

  /** Find the clusters of all frames with the present settings and scribbles, without a film. */
  async searchAll(): Promise<void> {
    const { store } = this;
    const overlay = store.overlay("labels");
    if (!overlay) return;
    this.forget();
    this.search = new AbortController();
    const { signal: life } = this.search;
    this.searching.value = true;
    this.uncertainty.value = new Map();
    const body = { document: store.document.peek(), ...store.place };
    const run = preview({
      project: store.projectId,
      what: overlay.preview,
      channel: "clusters",
      body,
      signal: life,
      onrecord: ({ header, payload }) => {
        if (header.type !== "clusters" || life.aborted) return;
        this.found.value = new Map(this.found.value).set(header.frame, payload);
        this.uncertainty.value = new Map(this.uncertainty.value).set(header.frame, header.uncertainty);
      },
    });
    await run.catch((error) => this.failed(error));
    if (!life.aborted) this.searching.value = false;
  }

  /** Drop the clusters, which are no longer valid, and end a running search. */
  forget(): void {
    this.search.abort();
    this.searching.value = false;
    this.found.value = new Map();
    this.uncertainty.value = this.ofFilm;
    this.map.value = null;
    this.redraw();
  }

  /** The corrected label maps of the selected layer. */
  get corrections(): readonly LabelCorrection[] {
    return picturesOf(this.store.layer.value, this.store.section("clusters")?.part);
  }

  correction(frame: number): LabelCorrection | undefined {
    return this.corrections.find((entry) => entry.frame === frame);
  }

  private async load(frame: number, correction: LabelCorrection | undefined): Promise<void> {
    if (this.waiting) return; // a stroke that is being stored is newer than what is stored
    const asset = correction && this.store.document.peek().assets[correction.image]?.id;
    const found = this.found.peek().get(frame);
    const map = asset
      ? await this.read(asset, api.paths.content(asset))
      : found
        ? enlarged(decodeLabels(found), this.store.size)
        : await this.fromFilm(frame);
    if (this.store.frame.peek() !== frame || this.waiting) return;
    this.map.value = map && { ...map, frame };
    this.redraw();
  }

  private async fromFilm(frame: number): Promise<LabelMap | null> {
    const film = this.film.value;
    const at = frame - (film?.request.frames?.[0] ?? 0);
    if (!film || at < 0) return null;
    const { artefact = "" } = this.store.overlay("labels") ?? {};
    const path = api.url`/v1/jobs/${film.id}/artefacts/${artefact}/${String(at).padStart(6, "0")}.png`;
    return this.read(path, path).catch((error) => {
      if (error instanceof api.Problem && error.status === 404) return null;
      throw error;
    });
  }

  private async read(key: string, path: string): Promise<LabelMap> {
    const known = this.known.get(key);
    if (known) return known;
    const answer = await api.request(path, { signal: this.life.signal });
    const map = decodeLabels(new Uint8Array(await answer.arrayBuffer()));
    if (this.known.size > 60) this.known.clear();
    this.known.set(key, map);
    return map;
  }

  /** The largest number of any cluster: a new one gets the next. */
  get largest(): number {
    const labels = [...this.uncertainty.value.values()].flatMap((frame) => Object.keys(frame).map(Number));
    const here = this.map.value ? [...new Set(this.map.value.labels)] : [];
    return Math.max(1, ...labels, ...here);
  }

  /** Make a map the corrected one of its frame. */
  correct(label: string, frame: number, map: LabelMap): void {
    const { place } = this.store; // another layer may be selected when it is stored
    const part = this.store.section("clusters")?.part ?? "";
    this.map.value = { ...map, frame };
    this.redraw();
    this.waiting += 1;
    this.store.storing.value += 1;
    const done = () => {
      this.waiting -= 1;
      this.store.storing.value -= 1;
    };
    this.pending = this.pending
      .then(() => this.save(label, place, part, frame, map))
      .then(done, (error) => {
        done();
        this.failed(error);
        this.load(frame, this.correction(frame)).catch(() => {}); // show what is stored
      });
  }

  private async save(label: string, place: LayerPlace, part: string, frame: number, map: LabelMap): Promise<void> {
    const file = new File([encodeLabels(map)], `labels-${frame}.png`, { type: "image/png" });
    const asset = await upload(file);
    this.known.set(asset.id, map);
    this.store.editDocument(label, (document) => {
      const stored = layerOf(shotOf(document, place.shot), place.layer);
      const present = stored && picturesOf<LabelCorrection>(stored, part).find((one) => one.frame === frame);
      const solve = present?.solve ?? solvedAround(frame, this.store.frames);
      const [next, image] = addAsset(document, stemOf(place, part, frame), { id: asset.id });
      const entry: LabelCorrection = { frame, image, solve };
      const put = (layer: Layer) => withPart(layer, part, putAtFrame(picturesOf<LabelCorrection>(layer, part), entry));
      return changeLayer(next, place, put);
    });
  }

  /** Every correction is stored. */
  settled(): Promise<void> {
    return this.pending;
  }

  remove(frame: number): void {
    this.edit("Remove a correction", (entries) => removeAtFrame(entries, frame));
  }

  setInterval(frame: number, solve: [number, number]): void {
    const change = (entry: LabelCorrection) => (entry.frame === frame ? { ...entry, solve } : entry);
    this.edit("Change the interval", (entries) => entries.map(change), `interval-${frame}`);
  }

  private edit(label: string, change: (entries: LabelCorrection[]) => LabelCorrection[], group = ""): void {
    const part = this.store.section("clusters")?.part;
    if (part) this.store.editPart<LabelCorrection[] | undefined>(label, part, (entries = []) => change(entries), group);
  }

  /** Draw the clusters over the stage; the context is in pixels of the video. */
  draw(context: CanvasRenderingContext2D): void {
    const map = this.map.value;
    if (!this.shown.value || !map || map.frame !== this.store.frame.value) return;
    if (this.overlay?.map !== map) this.overlay = { map, canvas: painted(map) };
    const { width, height } = this.store.size;
    context.save();
    context.globalAlpha = OVERLAY_ALPHA;
    context.imageSmoothingEnabled = false;
    context.drawImage(this.overlay.canvas, 0, 0, width, height);
    context.restore();
  }
}

/** The data on which the clusters of a layer depend. */
const clusterBasis = ({ method, params, seed, parts = {} }: Layer, overlay: Overlay | undefined): string =>
  JSON.stringify([method, params, seed, overlay?.after.map((part) => parts[part])]);

const usable = ({ job, shot, variant }: ProjectJob, wanted: string, artefacts: readonly string[]): boolean =>
  job?.state === "succeeded" &&
  shot === wanted &&
  !variant &&
  artefacts.every((name) => !name || job.results.includes(name));

async function readUncertainty(
  film: Job,
  artefact: string,
  signal: AbortSignal,
): Promise<Map<number, FrameUncertainty>> {
  const entries = await api.get<Page<{ url: string }>>(api.url`/v1/jobs/${film.id}/artefacts/${artefact}`, signal);
  const first = film.request.frames?.[0] ?? 0;
  const found = new Map<number, FrameUncertainty>();
  for (const { url } of entries.items) {
    const frames = await api.get<Record<string, FrameUncertainty>>(url, signal);
    for (const [frame, labels] of Object.entries(frames)) found.set(first + Number(frame), labels);
  }
  return found;
}

function painted(map: LabelMap): HTMLCanvasElement {
  const [canvas, context] = createCanvas(map);
  const image = context.createImageData(map.width, map.height);
  const pixels = new Uint32Array(image.data.buffer);
  const colours = new Map<number, number>();
  map.labels.forEach((label, i) => {
    let colour = colours.get(label);
    if (colour === undefined) {
      const [r, g, b] = colourOf(label);
      colour = (0xff000000 | (b << 16) | (g << 8) | r) >>> 0;
      colours.set(label, colour);
    }
    const edge = i % map.width > 0 && map.labels[i - 1] !== label;
    pixels[i] = edge ? 0xffffffff : colour;
  });
  context.putImageData(image, 0, 0);
  return canvas;
}

/** The least certain cluster of a frame: its uncertainty, 0..1. */
export const worst = (frame: FrameUncertainty | undefined): number => Math.max(0, ...Object.values(frame ?? {}));

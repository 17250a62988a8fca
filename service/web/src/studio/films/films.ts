/** Films of the project: the one that is painted now, and the newest finished one, which the stage shows. */

import { effect, signal } from "@preact/signals";
import * as api from "../../api/api";
import type { Job, Output } from "../../api/schemas";
import { isFinal, type Queue, stateWord } from "../../jobs/progress";
import { watchJob } from "../../jobs/watch-job";
import { announce } from "../../ui/notices";
import { projectJobs } from "../document/api";
import { type FilmSource, openFilm } from "../previews/frames";
import { PAINTED_VIEWS, type Store } from "../state/store";
import type { Film } from "./film";

/** The frame of a film that becomes a key. */
export interface FilmFrame {
  film: string;
  /** Frame of the video. */
  frame: number;
}

/** A submitted film in its present state. */
export interface FilmState {
  job: Job;
  queue: Queue | null;
}

/** A film that the browser plays; frames are those of the video. */
export interface PlayedFilm {
  readonly last: number;
  /** The frame that is played now. */
  frame(): number;
  stop(): void;
}

export class Films {
  /** The newest film of the shot that was submitted or found unfinished in this visit. */
  readonly current = signal<FilmState | null>(null);
  /** The newest finished frame of that film while it is painted; null: none. */
  readonly newest = signal<HTMLImageElement | null>(null);
  private loading = false;
  private watching = new AbortController();
  private source: { job: string; frames: FilmSource } | null = null;
  private readonly dispose: () => void;

  constructor(
    private readonly store: Store,
    private readonly whole: Film,
    private readonly redraw: () => void,
  ) {
    this.dispose = effect(() => {
      const film = store.film.value;
      const view = store.stageView.value;
      const shown = view === "film" || (store.playing.value && PAINTED_VIEWS.includes(view));
      if (!film || !shown || (view === "film" && this.newest.value)) this.closeSource();
      else this.open(film).seek(store.frame.value - firstOf(film));
    });
  }

  /** Find the newest finished film of the shot, and follow a newer one that is not finished. */
  async find(): Promise<void> {
    const shot = this.store.shotId;
    const jobs = (await projectJobs(this.store.projectId)).filter((one) => one.shot === shot && !one.variant);
    this.store.film.value = jobs.find(({ job }) => job.state === "succeeded" && isWhole(job))?.job ?? null;
    const newest = jobs[0]?.job;
    if (newest && !isFinal(newest) && !this.current.peek()) this.watch(newest);
  }

  /**
   * Submit the shots of the film that have changed, or the frames [first, end) of this shot, or this shot with one layer
   * alone. Throws a Problem if something keeps it from that.
   */
  async submit(saveAll: () => Promise<boolean>, range?: [number, number], layer = ""): Promise<void> {
    const shot = this.store.shotId;
    const output = layer ? alone(this.store, layer) : withOverlays(this.store);
    const only = range || layer ? { shot, ...(range && { range }) } : undefined;
    const made = await this.whole.submit(saveAll, { output, ...(only && { only }) });
    const own = made.find((one) => one.shot === shot);
    if (own) this.watch(own.job);
  }

  async cancel(): Promise<void> {
    const { value } = this.current;
    if (value) this.follow(await api.act(value.job.id, "cancel"), null);
  }

  /** Take the finished, failed or cancelled film off the panel. */
  dismiss(): void {
    this.watching.abort();
    this.current.value = null;
    this.showNewest(null);
  }

  /** The picture of the film at the shown frame, while the stage shows the film; null: it has none, or not yet. */
  picture(): CanvasImageSource | null {
    const film = this.store.film.value;
    const frames = this.source?.frames;
    if (!film || !frames || !filmHas(this.store, this.store.frame.value)) return null;
    return frames.shown >= 0 ? frames.picture : null;
  }

  /** The frame of the video that the film's picture shows; -1: none. */
  get shown(): number {
    const film = this.store.film.value;
    return film && this.picture() ? (this.source?.frames.shown ?? -1) + firstOf(film) : -1;
  }

  /** What the stage shows at the present frame in a view of paintings; while one plays, the newest film's frame, too. */
  painting(): { picture: CanvasImageSource; from: "preview" | "film" } | null {
    const { store } = this;
    const present = store.presentResult(store.frame.value);
    const film = store.playing.value && !present ? this.picture() : null;
    if (film) return { picture: film, from: "film" };
    const result = present ?? store.results.value.get(store.frame.value);
    return result ? { picture: result.picture, from: "preview" } : null;
  }

  /** Whether the newest film shows what the shot shows now. */
  get present(): boolean {
    const { film, shotId } = this.store;
    return film.value !== null && this.whole.jobOf(shotId)?.id === film.value.id;
  }

  /** Let the browser play the film from the present frame on; null: it cannot, or the stage does not show the film. */
  play(rate: number, sound: boolean): PlayedFilm | null {
    const film = this.store.film.peek();
    const frames = this.source?.frames;
    const frame = this.store.frame.peek();
    if (!film || !frames || !filmHas(this.store, frame) || !frames.play(frame - firstOf(film), rate, sound))
      return null;
    const last = (film.request.frames?.[1] ?? this.store.frames) - 1;
    return { last, frame: () => Math.min(last, frames.now + firstOf(film)), stop: () => frames.pause() };
  }

  close(): void {
    this.dispose();
    this.watching.abort();
    this.closeSource();
    this.showNewest(null);
  }

  private watch(job: Job): void {
    this.watching.abort();
    this.watching = new AbortController();
    const { signal } = this.watching;
    this.showNewest(null);
    this.current.value = { job, queue: null };
    const onchange = (now: Job, queue: Queue | null) => {
      if (now.state !== this.current.peek()?.job.state) announce(`The film: ${stateWord(now)}`);
      this.follow(now, queue);
      if (!isFinal(now) && now.results.includes("preview")) this.loadNewest(now.id, signal);
    };
    watchJob(job.id, { onchange }, signal);
  }

  private follow(job: Job, queue: Queue | null): void {
    this.current.value = { job, queue };
    if (job.state === "succeeded" && isWhole(job)) this.store.film.value = job;
    if (isFinal(job)) this.showNewest(null);
  }

  private async loadNewest(job: string, signal: AbortSignal): Promise<void> {
    if (this.loading) return;
    this.loading = true;
    const picture = new Image();
    try {
      picture.src = await api.objectUrl(api.paths.file(job, "preview"), signal);
      await picture.decode();
      const state = this.current.peek();
      if (signal.aborted || !state || isFinal(state.job)) URL.revokeObjectURL(picture.src);
      else this.showNewest(picture);
    } catch {
      URL.revokeObjectURL(picture.src); // the next change of the film asks again
    }
    this.loading = false;
  }

  private showNewest(picture: HTMLImageElement | null): void {
    const { stageView, film } = this.store;
    URL.revokeObjectURL(this.newest.peek()?.src ?? "");
    this.newest.value = picture;
    if (!picture && !film.peek() && stageView.peek() === "film") stageView.value = "compare";
    this.redraw();
  }

  private open(film: Job): FilmSource {
    if (this.source?.job !== film.id) {
      this.closeSource();
      this.source = { job: film.id, frames: openFilm(film, this.store.asset, this.redraw) };
    }
    return this.source.frames;
  }

  private closeSource(): void {
    this.source?.frames.close();
    this.source = null;
  }
}

/** The frame of the video that a film begins with. */
export const firstOf = (film: Job): number => film.request.frames?.[0] ?? 0;

/** Whether the newest film has this frame of the video. */
export function filmHas(store: Store, frame: number): boolean {
  const film = store.film.value;
  const [first, end] = film?.request.frames ?? [0, store.frames];
  return film !== null && first <= frame && frame < end;
}

/** A frame of a film at full size, PNG: the exact pixels if the film has PNG frames. */
export async function filmFrame({ film, frame }: FilmFrame): Promise<Blob> {
  const job = await api.job(film);
  return (await api.request(api.url`/v1/jobs/${film}/frames/${frame - firstOf(job)}`)).blob();
}

/** Whether the film is a picture of the whole shot, not of one layer with its opacity. */
const isWhole = (film: Job): boolean => film.request.output?.alpha !== "painted";

/** The output for a layer alone, which makes no artefacts, and of the passes those of its method. */
function alone(store: Store, layer: string): Output & { layer: string } {
  const own = store.shot.value.layers.find(({ id }) => id === layer);
  const makes = own ? (store.methodOf(own)?.makes_passes ?? []).map(({ name }) => name) : [];
  const { output = {} } = store.document.value;
  const passes = (output.passes ?? []).filter((name) => makes.includes(name));
  return { ...output, artefacts: [], passes, layer };
}

/** The output with what the studio draws over the film; undefined: as the document has it. */
function withOverlays(store: Store): Output | undefined {
  const [only, ...others] = store.shot.value.layers.filter((layer) => layer.visible !== false);
  const plain = only && !others.length && (only.opacity ?? 1) === 1 && (only.blend ?? "over") === "over" && !only.matte;
  const overlays = plain ? (store.methodOf(only)?.studio.sections ?? []).map((section) => section.overlay) : [];
  const artefacts = overlays.flatMap((one) => [one?.artefact, one?.uncertainty]).filter((name) => name) as string[];
  if (!artefacts.length || store.document.value.shots.length > 1) return undefined;
  const { output = {} } = store.document.value;
  return { ...output, artefacts: [...new Set([...(output.artefacts ?? []), ...artefacts])] };
}

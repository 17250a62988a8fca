/** The film of the project: which job paints what each shot shows, how far they are, and the film in one file. */

import { computed, effect, signal } from "@preact/signals";
import * as api from "../../api/api";
import { joined } from "../../api/joined";
import type { Job, Output, Schemas } from "../../api/schemas";
import { isFinal } from "../../jobs/progress";
import { announce } from "../../ui/notices";
import { checkProject, submitProject } from "../document/api";
import { isPassing } from "../document/autosave";
import type { Session } from "../state/session";

export type ShotFilm = Omit<Schemas["ShotFilmOut"], "job"> & { job: Job | null };

const POLL_MS = 1500;
const REST_MS = 800;

/** Address of the film of a version in one file. */
export const filmPath = (project: string, version: number): string =>
  api.url`/v1/projects/${project}/film/content?version=${version}`;

export class Film {
  /** As the service knows the saved document; empty before it was asked. */
  readonly shots = signal<readonly ShotFilm[]>([]);
  /** The version of which the film is ready; 0: it is not. */
  readonly ready = signal(0);
  /** How shots of different sizes or frame rates are joined, in sentences. */
  readonly notes = signal<readonly string[]>([]);
  /** Jobs that were submitted together and are not finished, or have failed since. */
  readonly submitted = signal<readonly string[]>([]);
  /** Shots whose film is not finished, in order. */
  readonly missing = computed(() => this.shots.value.filter(({ job }) => job?.state !== "succeeded"));
  readonly painting = computed(() => this.shots.value.some(({ job }) => job && !isFinal(job)));
  private timer = 0;
  private asked = 0;
  private readonly dispose: () => void;

  constructor(private readonly session: Session) {
    this.dispose = effect(() => {
      const saved = session.saving.value.name === "saved";
      session.document.value;
      clearTimeout(this.timer);
      if (saved) this.later(REST_MS);
    });
  }

  /** The job that paints what a shot of the saved document shows. */
  jobOf(shot: string): Job | null {
    return this.shots.value.find((one) => one.shot === shot)?.job ?? null;
  }

  /** Address of the film in one file, of the version that is ready. */
  get path(): string {
    return filmPath(this.session.projectId, this.ready.value);
  }

  /** Wait until the film of the version that is ready is one file; `onwait` is called with the fraction done. */
  joined(onwait: (done: number) => void): Promise<void> {
    const film = api.url`/v1/projects/${this.session.projectId}/film?version=${this.ready.peek()}`;
    return joined(film, this.path, onwait);
  }

  /**
   * Save the project and submit the shots that have changed, or only one shot, or its frames [first, end). Returns the job
   * of each shot. Throws a Problem if something keeps it from that.
   */
  async submit(
    saveAll: () => Promise<boolean>,
    { output, only }: { output?: Output | undefined; only?: { shot: string; range?: [number, number] } } = {},
  ): Promise<{ shot: string; job: Job }[]> {
    const { projectId } = this.session;
    if (!(await saveAll()))
      throw new api.Problem({ detail: "The project is not saved.", remedy: "See the message above the stage." });
    const [fault] = await checkProject(projectId);
    if (fault) throw new api.Problem({ detail: fault.message, remedy: fault.remedy });
    const wishes = only ? { shots: [only.shot], ...(only.range && { range: only.range }) } : { changed: true };
    const made = await submitProject(projectId, { ...wishes, ...(output && { output }) }, api.token());
    if (!only) this.submitted.value = made.map(({ job }) => job.id);
    await this.refresh();
    return made;
  }

  /** Cancel what is not finished of the film. */
  async cancel(): Promise<void> {
    const jobs = this.shots.value.flatMap(({ job }) => (job && !isFinal(job) ? [job] : []));
    await Promise.all(jobs.map(({ id }) => api.act(id, "cancel")));
    this.submitted.value = [];
    await this.refresh();
  }

  async refresh(): Promise<void> {
    clearTimeout(this.timer);
    const turn = ++this.asked;
    const { projectId } = this.session;
    try {
      const found = await api.get<{ version: number; ready: boolean; shots: ShotFilm[]; notes: string[] }>(
        api.url`/v1/projects/${projectId}/film`,
      );
      if (turn !== this.asked) return;
      const before = this.ready.peek();
      this.shots.value = found.shots;
      this.notes.value = found.notes;
      this.ready.value = found.ready ? found.version : 0;
      if (this.ready.peek() && !before && this.submitted.peek().length) announce("The film is finished.");
    } catch (error) {
      if (turn !== this.asked) return;
      if (isPassing(api.asProblem(error))) {
        this.later(POLL_MS); // the service is away or busy: what was known stays
        return;
      }
      this.shots.value = []; // a document that cannot be rendered yet has no film
      this.ready.value = 0;
    }
    if (this.painting.peek()) this.later(POLL_MS);
  }

  private later(ms: number): void {
    this.timer = window.setTimeout(() => this.refresh(), ms);
  }

  close(): void {
    this.dispose();
    this.asked++;
    clearTimeout(this.timer);
  }
}

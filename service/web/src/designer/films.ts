/** Finished films of the project: their frames become keys that the user corrects. */

import * as api from "../shared/api";
import { projectJobs } from "./api";
import type { Store } from "./store";

/** The frame of a film that the page is asked to make a key. */
export interface FilmFrame {
  film: string;
  /** Frame of the video. */
  frame: number;
}

/** Find the newest finished film of the shot. */
export async function findFilm(store: Store): Promise<void> {
  const shot = store.shot.peek().id;
  const jobs = await projectJobs(store.projectId);
  const found = jobs.find(({ job, shot: of, variant }) => of === shot && !variant && job.state === "succeeded");
  store.film.value = found?.job ?? null;
}

/** Whether the newest film has this frame of the video. */
export function filmHas(store: Store, frame: number): boolean {
  const film = store.film.value;
  const [first, end] = film?.request.frames ?? [0, store.frames];
  return film !== null && first <= frame && frame < end;
}

/** A frame of a film at full size, PNG: the exact pixels if the film has PNG frames. */
export async function filmFrame({ film, frame }: FilmFrame): Promise<Blob> {
  const job = await api.job(film);
  const at = frame - (job.request.frames?.[0] ?? 0);
  return (await api.request(api.url`/v1/jobs/${film}/frames/${at}`)).blob();
}

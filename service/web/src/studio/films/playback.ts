/** Playing the frames of the shot at a speed, with sound, once or again and again: J, K and L, and the play button. */

import { effect, type ReadonlySignal, type Signal, signal } from "@preact/signals";
import type { FilmSource } from "../previews/frames";
import type { Store } from "../state/store";
import { shuttle } from "../state/timeline";
import type { Films, PlayedFilm } from "./films";

export interface Playback {
  /** Frames per frame time: 1 = as filmed, negative = backwards, 0 = stopped. */
  readonly speed: ReadonlySignal<number>;
  shuttle(key: "j" | "k" | "l"): void;
  toggle(): void;
  stop(): void;
  close(): void;
}

/** Kept for all shots of a visit. */
export const looping: Signal<boolean> = signal(false);
export const audible: Signal<boolean> = signal(true);

/**
 * Forwards, the browser plays: the film where the stage shows it, else the clip; the playhead follows. Backwards, or if it
 * cannot, frames are sought one after the other, without sound.
 */
export function createPlayback(store: Store, films: Films, clip: FilmSource): Playback {
  const speed = signal(0);
  let film: PlayedFilm | null = null;
  let source = false;
  let pending = 0;
  let began = 0;
  let from = 0;

  function run(next: number): void {
    film?.stop();
    if (source) clip.pause();
    film = null;
    source = false;
    speed.value = next;
    store.playing.value = next !== 0;
    cancelAnimationFrame(pending);
    began = performance.now();
    from = store.frame.value;
    if (next > 0) begin(next);
    if (next) pending = requestAnimationFrame(tick);
  }

  /** The film has the sound that is heard; beside it, the clip plays in silence. */
  function begin(rate: number): void {
    film = films.play(rate, audible.peek());
    source = clip.play(from, rate, audible.peek() && !film);
  }

  function tick(now: number): void {
    if (speed.value > 0 && !film && store.stageView.value !== "source") retryFilm();
    const timed = from + Math.trunc(((now - began) / 1000) * store.fps * speed.value);
    const frame = film?.frame() ?? (source ? clip.now : timed);
    const [first, end] = store.reach.value;
    const last = Math.min(film?.last ?? end - 1, end - 1);
    store.goTo(Math.min(frame, last));
    const ended = speed.value > 0 ? frame >= last : frame <= first;
    if (ended && looping.value && last > first) again(speed.value > 0 ? first : last);
    else if (ended) run(0);
    else pending = requestAnimationFrame(tick);
  }

  /** The film may have to be loaded first; once it plays, it has the sound. */
  function retryFilm(): void {
    film = films.play(speed.value, audible.peek());
    if (film && source) source = clip.play(store.frame.value, speed.value, false);
  }

  function again(frame: number): void {
    const rate = speed.value;
    run(0);
    store.goTo(frame);
    run(rate);
  }

  const dispose = effect(() => {
    audible.value;
    if (speed.peek() > 0) run(speed.peek());
  });

  return {
    speed,
    shuttle: (key) => run(shuttle(speed.value, key)),
    toggle() {
      const [first, end] = store.reach.value;
      const stopped = speed.value === 0;
      if (stopped && store.frame.value >= end - 1) store.goTo(first);
      run(stopped ? 1 : 0);
    },
    stop: () => run(0),
    close() {
      dispose();
      run(0);
    },
  };
}

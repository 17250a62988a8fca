/** Playing the frames at a speed: J, K and L, and the play button. */

import { type ReadonlySignal, signal } from "@preact/signals";
import type { Store } from "../state/store";
import { shuttle } from "../state/timeline";
import type { Films, PlayedFilm } from "./films";

export interface Playback {
  /** Frames per frame time: 1 = as filmed, negative = backwards, 0 = stopped. */
  readonly speed: ReadonlySignal<number>;
  shuttle(key: "j" | "k" | "l"): void;
  toggle(): void;
  stop(): void;
}

/** `films`: where the stage shows the film, the browser plays it, and the playhead follows. */
export function createPlayback(store: Store, films: Films): Playback {
  const speed = signal(0);
  let film: PlayedFilm | null = null;
  let pending = 0;
  let began = 0;
  let from = 0;

  function run(next: number): void {
    film?.stop();
    film = null;
    speed.value = next;
    store.playing.value = next !== 0;
    if (next === 1) film = films.play();
    cancelAnimationFrame(pending);
    began = performance.now();
    from = store.frame.value;
    if (next) pending = requestAnimationFrame(tick);
  }

  function tick(now: number): void {
    if (speed.value === 1) film ??= films.play(); // it may have to be loaded first
    const frame = film?.frame() ?? from + Math.trunc(((now - began) / 1000) * store.fps * speed.value);
    store.goTo(frame);
    const last = film?.last ?? store.frames - 1;
    const ended = speed.value > 0 ? frame >= last : frame <= 0;
    if (ended) run(0);
    else pending = requestAnimationFrame(tick);
  }

  return {
    speed,
    shuttle: (key) => run(shuttle(speed.value, key)),
    toggle() {
      const stopped = speed.value === 0;
      if (stopped && store.frame.value >= store.frames - 1) store.goTo(0);
      run(stopped ? 1 : 0);
    },
    stop: () => run(0),
  };
}

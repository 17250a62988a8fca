/** The film's own time line above its shots: play all of them, drag along them, and play a range of them again and again. */

import { useRef } from "preact/hooks";
import { clock, duration } from "../../ui/format";
import { Icon, IconButton } from "../../ui/icons";
import { titleOf } from "../document/shots";
import { keyText } from "../state/key-bindings";
import type { Store } from "../state/store";
import type { Film } from "./film";
import type { FilmPlayer } from "./film-player";
import {
  endOf,
  type FilmRange,
  filmLength,
  frameOf,
  pieceNumber,
  placeAt,
  secondAt,
  secondOf,
  stepped,
} from "./film-times";
import { looping, type Playback } from "./playback";
import { hear } from "./scrub-sound";

interface FilmBarProps {
  player: FilmPlayer;
  film: Film;
  /** The shown shot. */
  store: Store;
  playback: Playback;
}

/** The second of the film at which the page is: of the player, or of the shown frame. */
const presentSecond = (player: FilmPlayer, store: Store): number =>
  player.open.value
    ? player.second.value
    : secondAt(player.pieces.value, { shot: store.shotId, frame: store.frame.value });

/** Play the film from the shown frame on, or stop it. */
export function toggleFilm(player: FilmPlayer, store: Store, playback: Playback): void {
  if (player.playing.peek()) {
    player.stop();
    return;
  }
  playback.stop();
  player.play(presentSecond(player, store), store.stageView.peek() === "source");
}

export function FilmBar({ player, film, store, playback }: FilmBarProps) {
  const all = player.pieces.value;
  if (all.length < 2) return null;
  const second = presentSecond(player, store);
  const number = pieceNumber(all, second);
  const piece = all[number];
  const loop = (range: FilmRange | null) => {
    player.range.value = range;
    looping.value = range !== null || looping.value;
  };
  const [from, to] = player.range.value ?? [0, filmLength(all)];
  const next = piece ? secondOf(piece, frameOf(piece, second) + 1) : second;
  return (
    <div class="film-bar" role="group" aria-label="The whole film">
      <button
        type="button"
        class="button small"
        title={`${player.playing.value ? "Stop the film" : "Play all shots"} (${keyText("film")})`}
        aria-label={player.playing.value ? "Stop the film" : "Play all shots"}
        onClick={() => toggleFilm(player, store, playback)}
      >
        <Icon name={player.playing.value ? "pause" : "play"} />
        {player.playing.value ? "Stop" : "Play all"}
      </button>
      <Track player={player} film={film} store={store} playback={playback} second={second} />
      <output aria-label="Position in the film">
        {clock(second)} of {clock(filmLength(all))}
      </output>
      <IconButton
        name="rangeStart"
        label="Loop from this frame"
        onClick={() => loop([second, to > second ? to : filmLength(all)])}
      />
      <IconButton name="rangeEnd" label="Loop to this frame" onClick={() => loop([from < next ? from : 0, next])} />
      {player.range.value && <IconButton name="close" label="Loop the whole film" onClick={() => loop(null)} />}
    </div>
  );
}

function Track({ player, film, store, playback, second }: FilmBarProps & { second: number }) {
  const track = useRef<HTMLDivElement>(null);
  const all = player.pieces.value;
  const length = filmLength(all);
  const share = (at: number) => `${(100 * at) / Math.max(length, 1e-6)}%`;
  const number = pieceNumber(all, second);
  const shown = all[number];
  const range = player.range.value;
  const scrub = (event: PointerEvent) => {
    const box = track.current?.getBoundingClientRect();
    if (!box) return;
    const at = Math.min(1, Math.max(0, (event.clientX - box.left) / box.width)) * length;
    player.scrub(at, store.stageView.peek() === "source");
    const place = placeAt(all, at);
    if (place)
      store.session.clip(place.shot).then(
        (clip) => hear(clip, place.frame),
        () => {},
      );
  };
  const go = (to: number) => {
    player.stop();
    playback.stop();
    const place = placeAt(all, to);
    if (place) store.session.show(place.shot, place.frame);
  };
  const onKey = (event: KeyboardEvent) => {
    const by = { ArrowLeft: -1, ArrowRight: 1, PageUp: 10, PageDown: -10 }[event.key];
    if (by) go(stepped(all, second, by));
    else if (event.key === "Home" || event.key === "End") go(event.key === "Home" ? 0 : length);
    else return;
    event.preventDefault();
    event.stopPropagation();
  };
  return (
    <div
      class="film-track"
      ref={track}
      role="slider"
      tabIndex={0}
      aria-label="Film"
      aria-valuemin={0}
      aria-valuemax={Number(length.toFixed(2))}
      aria-valuenow={Number(second.toFixed(2))}
      aria-valuetext={
        shown &&
        `Shot ${number + 1} of ${all.length}, frame ${frameOf(shown, second) + 1}, ${duration(second)} of ${duration(length)}`
      }
      onKeyDown={onKey}
      onDragStart={(event) => event.preventDefault()}
      onPointerDown={(event) => {
        if (event.button !== 0) return;
        event.preventDefault();
        event.currentTarget.focus({ preventScroll: true });
        event.currentTarget.setPointerCapture(event.pointerId);
        playback.stop();
        scrub(event);
      }}
      onPointerMove={(event) => event.currentTarget.hasPointerCapture(event.pointerId) && scrub(event)}
      onPointerUp={() => player.stop()}
      onPointerCancel={() => player.stop()}
    >
      {all.map((piece, i) => (
        <span
          key={piece.shot}
          class="film-piece"
          data-painted={film.jobOf(piece.shot)?.state === "succeeded"}
          data-shown={i === number}
          title={titleOf(store.document.value, piece.shot)}
          style={{ left: share(piece.from), width: `calc(${share(endOf(piece) - piece.from)} - 2px)` }}
        />
      ))}
      {range && <span class="film-range" style={{ left: share(range[0]), width: share(range[1] - range[0]) }} />}
      <span class="playhead" style={{ left: share(second) }} />
    </div>
  );
}

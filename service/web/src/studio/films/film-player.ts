/** Plays the film over the stage: its shots in order, each from its in to its out point, with sound. */

import { effect, type Signal, signal, untracked } from "@preact/signals";
import type { Asset } from "../../api/schemas";
import { notify } from "../../ui/notices";
import { framesOf } from "../document/shots";
import type { Size } from "../drawing/geometry";
import { type FilmSource, openFilm, openFrames } from "../previews/frames";
import type { Session } from "../state/session";
import type { Film } from "./film";
import {
  endOf,
  type FilmPlace,
  type FilmRange,
  frameOf,
  type Piece,
  pieceNumber,
  pieces,
  placeAt,
  playedRange,
  rateFor,
  secondOf,
} from "./film-times";
import { firstOf } from "./films";
import { audible, looping } from "./playback";

/** Half of the shortest frame. */
const NEAR_S = 0.004;
/** The longest time that a browser is expected to need from the call to the first new frame, ms. */
const MOST_LEAD_MS = 500;
/** Frames behind the film's clock from which a shot goes on where it should be. */
const FAR_FRAMES = 12;

/** The shot that the player shows: number from 0; whether its painting is shown, or else its video. */
export interface Shown {
  number: number;
  painted: boolean;
}

/** A shot that is open: its film or its clip, whose frame 0 is the clip's frame `offset`. */
interface Opened extends Shown {
  piece: Piece;
  source: FilmSource;
  offset: number;
  /** The frame with which it begins to play. */
  from: number;
  /** When it began, ms; 0: not yet. Where the browser plays it, its own clock counts. */
  began: number;
  byBrowser: boolean;
  /** How fast it plays, relative to its own speed. */
  rate: number;
}

export class FilmPlayer {
  /** The shots; empty before their clips are known. */
  readonly pieces = signal<readonly Piece[]>([]);
  /** The second of the film that is shown, while the player is open. */
  readonly second = signal(0);
  /** Whether the player covers the stage. */
  readonly open = signal(false);
  readonly playing = signal(false);
  readonly shown = signal<Shown | null>(null);
  /** What is played again and again; null: the whole film. */
  readonly range: Signal<FilmRange | null> = signal(null);
  /** Whether it shows the shots' videos, also where they are painted. */
  originals = false;
  private canvas: HTMLCanvasElement | null = null;
  private clips = new Map<string, Asset>();
  private current: Opened | null = null;
  private next: Opened | null = null;
  private pending = 0;
  private drawn = "";
  /** How long the browser needs to begin to play: the next shot is begun, without sound, so long before its turn. */
  private leadMs = 60;
  /** The film's clock: the second that was shown at a time, ms. Shots that begin late catch up with it. */
  private clock: { second: number; at: number } | null = null;
  private readonly closers: (() => void)[];

  constructor(
    private readonly session: Session,
    private readonly film: Film,
  ) {
    this.closers = [
      effect(() => {
        session.document.value;
        untracked(() => this.load().catch(notify));
      }),
      effect(() => {
        audible.value;
        untracked(() => this.current?.byBrowser && this.begin(this.current));
      }),
    ];
  }

  /** Size of the film: that of its first shot. */
  get size(): Size {
    const clip = this.clips.get(this.pieces.peek()[0]?.shot ?? "");
    return { width: clip?.info.width ?? 16, height: clip?.info.height ?? 9 };
  }

  /** The frame of a shot that is shown. */
  get place(): FilmPlace | null {
    return placeAt(this.pieces.peek(), this.second.peek());
  }

  /** Play from a second of the film on, or from the start of what is played if that is over. `originals`: the videos. */
  play(second: number, originals: boolean): void {
    const film = this.pieces.peek();
    if (!film.length) return;
    const [from, to] = playedRange(film, this.range.peek());
    const start = from - NEAR_S <= second && second < to - 1 / 60 ? second : from;
    this.originals = originals;
    this.open.value = true;
    this.playing.value = true;
    this.showAt(start);
    cancelAnimationFrame(this.pending);
    this.pending = requestAnimationFrame(this.tick);
  }

  /** Show a second of the film without playing, while the pointer drags along it. */
  scrub(second: number, originals: boolean): void {
    this.originals = originals;
    this.halt();
    this.open.value = true;
    this.showAt(second);
  }

  /** Draw the film on this canvas from now on. */
  show(canvas: HTMLCanvasElement | null): void {
    this.canvas = canvas;
    this.drawn = "";
    this.draw();
  }

  /** Leave the player: the stage shows the frame at which it was. */
  stop(): void {
    if (!this.open.peek()) return;
    const place = this.place;
    this.halt();
    this.open.value = false;
    this.closeAll();
    if (place) this.session.show(place.shot, place.frame);
  }

  close(): void {
    this.halt();
    this.closeAll();
    for (const close of this.closers) close();
  }

  private halt(): void {
    cancelAnimationFrame(this.pending);
    this.playing.value = false;
    this.clock = null;
    this.current?.source.pause();
    if (this.current) this.current.began = 0;
  }

  private async load(): Promise<void> {
    const document = this.session.document.peek();
    const found = await Promise.all(document.shots.map(({ id }) => this.session.clip(id)));
    if (document !== this.session.document.peek()) return;
    this.clips = new Map(document.shots.map(({ id }, i) => [id, found[i] as Asset]));
    const shots = document.shots.map((shot, i) => {
      const { frames = 1, fps = 25 } = found[i]?.info ?? {};
      const [first, end] = framesOf(shot, Math.max(1, frames));
      return { shot: shot.id, first, end, fps: fps || 25 };
    });
    if (JSON.stringify(shots) !== JSON.stringify(this.pieces.peek().map(({ from: _from, ...shot }) => shot)))
      this.pieces.value = pieces(shots);
  }

  private showAt(second: number): void {
    const film = this.pieces.peek();
    this.clock = null;
    const number = Math.max(0, pieceNumber(film, second));
    const piece = film[number];
    if (!piece) return;
    const frame = frameOf(piece, second);
    const { current } = this;
    if (current?.number === number && current.piece === piece && current.painted === this.isPainted(piece)) {
      current.source.pause();
      Object.assign(current, { from: frame, began: 0, rate: 1 });
    } else {
      current?.source.close();
      this.current = this.opened(number, piece, frame);
    }
    this.current?.source.seek(frame - (this.current?.offset ?? 0));
    this.second.value = secondOf(piece, frame);
    this.tell();
    this.draw();
  }

  private isPainted = ({ shot }: Piece): boolean => !this.originals && this.film.jobOf(shot)?.state === "succeeded";

  private opened(number: number, piece: Piece, from: number): Opened {
    const clip = this.clips.get(piece.shot) as Asset;
    const job = this.isPainted(piece) ? this.film.jobOf(piece.shot) : null;
    const redraw = () => {
      this.drawn = "";
      this.draw();
    };
    const source = job ? openFilm(job, clip, redraw) : openFrames(clip, redraw);
    return {
      number,
      piece,
      painted: job !== null,
      source,
      offset: job ? firstOf(job) : 0,
      from,
      began: 0,
      byBrowser: false,
      rate: 1,
    };
  }

  private tell(): void {
    const { number = 0, painted = false } = this.current ?? {};
    const before = this.shown.peek();
    if (before?.number !== number || before.painted !== painted) this.shown.value = { number, painted };
  }

  /** Let a shot play, if it has its first frame; with sound once it is the shot's turn. */
  private begin(shot: Opened): void {
    const { source, offset } = shot;
    const heard = audible.peek() && shot === this.current;
    if (shot.began && shot.byBrowser) source.play(source.now, shot.rate, heard);
    else if (source.play(shot.from - offset, 1, heard))
      Object.assign(shot, { began: performance.now(), byBrowser: true });
    else if (!source.plays && source.shown >= 0 && shot === this.current)
      Object.assign(shot, { began: performance.now(), byBrowser: false });
    if (shot.began && shot === this.current) this.prepare(shot);
  }

  /** Open what is played after a shot, so that it follows without a pause. */
  private prepare({ number, piece }: Opened): void {
    const film = this.pieces.peek();
    const [from, to] = playedRange(film, this.range.peek());
    const last = endOf(piece) > to - NEAR_S || number === film.length - 1;
    if (last && !looping.peek()) return;
    const second = last ? from : endOf(piece) + NEAR_S;
    const following = pieceNumber(film, second);
    const after = film[following];
    if (!after) return;
    const frame = frameOf(after, second);
    if (this.next?.number === following && this.next.piece === after && this.next.from === frame) return;
    this.next?.source.close();
    this.next = this.opened(following, after, frame);
    this.next.source.seek(frame - this.next.offset);
  }

  /** Learn how long the browser took to begin a shot, from the frames that it has shown since. */
  private learn({ began, byBrowser, source, from, offset, piece }: Opened): void {
    if (!byBrowser || !began) return;
    const took = performance.now() - began - (1000 * (source.now + offset - from)) / piece.fps;
    this.leadMs = Math.min(MOST_LEAD_MS, Math.max(0, (this.leadMs + took) / 2));
  }

  /** Begin the next shot a little before its turn. */
  private lead(frame: number, { piece }: Opened, to: number): void {
    const { next } = this;
    if (!next || next.began || !next.source.plays) return;
    const leftMs = 1000 * (Math.min(to, endOf(piece)) - secondOf(piece, frame));
    if (leftMs < this.leadMs) this.begin(next);
  }

  private tick = (now: number): void => {
    const shot = this.current;
    if (!shot || !this.playing.peek()) return;
    this.pending = requestAnimationFrame(this.tick);
    if (!shot.began) this.begin(shot);
    if (!shot.began) return; // its first frame is not there yet
    const { piece, source, offset } = shot;
    const due = this.due(now, shot);
    const frame = shot.byBrowser ? source.now + offset : frameOf({ ...piece, end: piece.end + 1 }, due);
    const [, to] = playedRange(this.pieces.peek(), this.range.peek());
    const second = secondOf(piece, frame);
    if (frame >= piece.end || second > to - NEAR_S || (shot.byBrowser && source.ended)) {
      this.advance(shot);
      return;
    }
    if (shot.byBrowser) this.keepTime(shot, frame, due);
    else source.seek(frame - offset);
    this.lead(frame, shot, to);
    this.second.value = second;
    this.draw();
  };

  /** The second of the film that is due. The clock begins with the first frame that the browser plays. */
  private due(now: number, { piece, source, offset, from, byBrowser }: Opened): number {
    const frame = byBrowser ? source.now + offset : from;
    if (!this.clock && (!byBrowser || frame > from)) this.clock = { second: secondOf(piece, frame), at: now };
    return this.clock ? this.clock.second + (now - this.clock.at) / 1000 : secondOf(piece, frame);
  }

  /** Play a shot a little faster while it is behind the film's clock, or slower; far behind, go on where it should be. */
  private keepTime(shot: Opened, frame: number, due: number): void {
    const { piece, source, offset } = shot;
    const late = (due - secondOf(piece, frame)) * piece.fps;
    const heard = audible.peek();
    const to = frameOf(piece, due);
    if (late > FAR_FRAMES && to < piece.end - 1) source.play(to - offset, 1, heard);
    const rate = rateFor(late, shot.rate);
    if (rate === shot.rate) return;
    shot.rate = rate;
    source.play(source.now, rate, heard);
  }

  private advance(shot: Opened): void {
    this.prepare(shot);
    const { next } = this;
    if (!next) {
      const [, to] = playedRange(this.pieces.peek(), this.range.peek());
      this.second.value = secondOf(shot.piece, frameOf(shot.piece, to - NEAR_S));
      this.stop();
      return;
    }
    this.learn(next);
    if (this.clock && next.piece.from < endOf(shot.piece) - NEAR_S) this.clock = null; // it begins anew
    this.next = null;
    this.current = next;
    this.begin(next);
    shot.source.pause();
    shot.source.close();
    const begun = next.byBrowser && next.began ? next.source.now + next.offset : next.from;
    this.second.value = secondOf(next.piece, Math.max(next.from, begun));
    this.tell();
    this.draw();
  }

  /** Draw the picture in the film's size; a shot of another size is scaled into it, with black borders, as the film is. */
  private draw(): void {
    const { canvas, current } = this;
    const picture = current?.source.picture;
    const context = canvas?.getContext("2d", { alpha: false });
    const key = `${current?.number}:${current?.painted}:${current?.source.shown}`;
    if (!canvas || !context || !current || !picture || key === this.drawn) return;
    const frame = current.source.shown + current.offset;
    if (frame < current.piece.first || frame >= current.piece.end) return; // it has played beyond the out point
    this.drawn = key;
    const { width, height } = this.size;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const scale = Math.min(width / current.source.size.width, height / current.source.size.height);
    const inner = [current.source.size.width * scale, current.source.size.height * scale] as const;
    context.fillRect(0, 0, width, height);
    context.drawImage(picture, (width - inner[0]) / 2, (height - inner[1]) / 2, ...inner);
    canvas.dataset.shot = String(current.number + 1);
    canvas.dataset.frame = String(frame);
    canvas.dataset.painted = String(current.painted);
  }

  private closeAll(): void {
    this.current?.source.close();
    this.next?.source.close();
    this.current = null;
    this.next = null;
    this.drawn = "";
  }
}

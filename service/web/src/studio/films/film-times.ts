/** Times of a film of several shots: where each shot begins, and which frame is shown at a time. Pure functions. */

/** A shot on the film's time line: frames [first, end) of its clip, from the second `from` of the film on. */
export interface Piece {
  shot: string;
  first: number;
  end: number;
  fps: number;
  from: number;
}

/** Seconds [from, to) of the film. */
export type FilmRange = readonly [from: number, to: number];

/** A frame of a shot; numbers of frames are the clip's. */
export interface FilmPlace {
  shot: string;
  frame: number;
}

/** Rounding errors of times are smaller, and frames are longer. Seconds. */
const ROUNDING_S = 1e-4;

/** The shots one after the other. */
export function pieces(shots: readonly Omit<Piece, "from">[]): Piece[] {
  let from = 0;
  return shots.map((shot) => {
    const piece = { ...shot, from };
    from = endOf(piece);
    return piece;
  });
}

/** The second of the film at which a piece ends. */
export const endOf = ({ first, end, fps, from }: Piece): number => from + (end - first) / fps;

export const filmLength = (film: readonly Piece[]): number => {
  const last = film.at(-1);
  return last ? endOf(last) : 0;
};

/** Number of the piece that is shown at a second of the film: the last one at its end and after it. */
export function pieceNumber(film: readonly Piece[], second: number): number {
  const next = film.findIndex((piece) => piece.from > second + ROUNDING_S);
  return (next < 0 ? film.length : next) - 1;
}

/** The frame that a piece shows at a second of the film. */
export const frameOf = (piece: Piece, second: number): number =>
  Math.min(
    piece.end - 1,
    Math.max(piece.first, piece.first + Math.floor((second - piece.from + ROUNDING_S) * piece.fps)),
  );

/** The second of the film at which a frame of a piece begins. */
export const secondOf = (piece: Piece, frame: number): number => piece.from + (frame - piece.first) / piece.fps;

/** The place of the film at a second of it. */
export function placeAt(film: readonly Piece[], second: number): FilmPlace | null {
  const piece = film[pieceNumber(film, second)];
  return piece ? { shot: piece.shot, frame: frameOf(piece, second) } : null;
}

/** The second of the film at which a frame of a shot begins; 0 if the film has no such shot. */
export function secondAt(film: readonly Piece[], { shot, frame }: FilmPlace): number {
  const piece = film.find((one) => one.shot === shot);
  return piece ? secondOf(piece, Math.min(piece.end - 1, Math.max(piece.first, frame))) : 0;
}

/** The place of the film's frame that is so many frames after another; within the film. */
export function stepped(film: readonly Piece[], second: number, by: number): number {
  let number = pieceNumber(film, second);
  let piece = film[number];
  if (!piece) return 0;
  let frame = frameOf(piece, second) + by;
  while (frame >= piece.end && film[number + 1]) {
    frame -= piece.end;
    piece = film[++number] as Piece;
    frame += piece.first;
  }
  while (frame < piece.first && film[number - 1]) {
    frame -= piece.first;
    piece = film[--number] as Piece;
    frame += piece.end;
  }
  return secondOf(piece, Math.min(piece.end - 1, Math.max(piece.first, frame)));
}

const CATCH_UP = 1.1;
/** Frames behind or before the film's clock from which a shot is played faster or slower, until it is within one. */
const OFF_FRAMES = 2;

/** How fast to play a shot that is so many frames late; `rate`: how fast it plays now. */
export function rateFor(late: number, rate: number): number {
  if (late > OFF_FRAMES || (rate > 1 && late > 1)) return CATCH_UP;
  return late < -OFF_FRAMES || (rate < 1 && late < 0) ? 1 / CATCH_UP : 1;
}

/** Seconds that are played: the range if there is one within the film, else the whole film. */
export function playedRange(film: readonly Piece[], range: FilmRange | null): FilmRange {
  const length = filmLength(film);
  if (!range) return [0, length];
  const from = Math.min(range[0], length);
  const to = Math.min(range[1], length);
  return to - from > ROUNDING_S ? [from, to] : [0, length];
}

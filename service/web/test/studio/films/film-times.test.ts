import { expect, test } from "vitest";
import {
  filmLength,
  pieceNumber,
  pieces,
  placeAt,
  playedRange,
  rateFor,
  secondAt,
  stepped,
} from "../../../src/studio/films/film-times";

/** Ten frames of a clip from its frame 5 on, 24 frames at twice the rate, three frames. */
const film = pieces([
  { shot: "a", first: 5, end: 15, fps: 12 },
  { shot: "b", first: 0, end: 24, fps: 24 },
  { shot: "c", first: 7, end: 10, fps: 12 },
]);

test("shots follow each other, each with its own frame rate", () => {
  expect(film.map(({ from }) => from)).toEqual([0, 10 / 12, 10 / 12 + 1]);
  expect(filmLength(film)).toBeCloseTo(10 / 12 + 1 + 0.25);
  expect(filmLength([])).toBe(0);
});

test("every frame of every shot is found at its own time, and at no other", () => {
  for (const { shot, first, end, fps } of film)
    for (let frame = first; frame < end; frame++) {
      const second = secondAt(film, { shot, frame });
      expect(placeAt(film, second)).toEqual({ shot, frame });
      expect(placeAt(film, second + 0.9 / fps)).toEqual({ shot, frame });
    }
});

test("times beyond the film show its ends, and frames outside a shot its first and last", () => {
  expect(placeAt(film, -1)).toBeNull();
  expect(placeAt(film, 99)).toEqual({ shot: "c", frame: 9 });
  expect(pieceNumber(film, filmLength(film))).toBe(2);
  expect(secondAt(film, { shot: "b", frame: 200 })).toBeCloseTo(10 / 12 + 23 / 24);
  expect(secondAt(film, { shot: "none", frame: 3 })).toBe(0);
});

test("a step leads from one shot into the next, and stays within the film", () => {
  const last = secondAt(film, { shot: "a", frame: 14 });
  expect(placeAt(film, stepped(film, last, 1))).toEqual({ shot: "b", frame: 0 });
  expect(placeAt(film, stepped(film, last, 26))).toEqual({ shot: "c", frame: 8 });
  expect(placeAt(film, stepped(film, last, 99))).toEqual({ shot: "c", frame: 9 });
  expect(placeAt(film, stepped(film, filmLength(film), -3))).toEqual({ shot: "b", frame: 23 });
  expect(placeAt(film, stepped(film, last, -99))).toEqual({ shot: "a", frame: 5 });
});

test("a range is played within the film; without one, or outside it, the whole film is", () => {
  expect(playedRange(film, null)).toEqual([0, filmLength(film)]);
  expect(playedRange(film, [0.5, 1.5])).toEqual([0.5, 1.5]);
  expect(playedRange(film, [1, 60])).toEqual([1, filmLength(film)]);
  expect(playedRange(film, [60, 90])).toEqual([0, filmLength(film)]);
});

test("a shot that is late plays faster until it is within a frame of the film's clock, and one that is early slower", () => {
  const rates = (lates: number[]) => {
    let rate = 1;
    return lates.map((late) => {
      rate = rateFor(late, rate);
      return rate;
    });
  };
  expect(rates([0.5, 1.9, 2.5, 1.5, 0.9, 1.5])).toEqual([1, 1, 1.1, 1.1, 1, 1]);
  expect(rates([-1, -2.5, -0.5, 0.5]).map((rate) => rate < 1)).toEqual([false, true, true, false]);
});

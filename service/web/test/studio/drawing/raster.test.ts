/** Layers that are drawn stroke by stroke, undone and redone are those that are drawn anew. */

import fc from "fast-check";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { type History, record, redo, startHistory, undo } from "../../../src/studio/document/undo";
import { ALL_BRUSHES } from "../../../src/studio/drawing/brushes";
import { createCanvas, PictureRaster } from "../../../src/studio/drawing/raster";
import {
  addStroke,
  changePictureLayer,
  type DrawnStroke,
  type KeyPicture,
  type Sample,
  type Stroke,
} from "../../../src/studio/drawing/strokes";
import { fakeCanvases, pixelsOf } from "./fake-canvas";

const SIZE = { width: 48, height: 32 };
const KEY = "s1/l1:4:keys";
const layer = (id: string) => ({ id, name: id, opacity: 1, visible: true, base: null, strokes: [] });
const FIRST: KeyPicture = { layers: [layer("below"), layer("paint")] };
/** Every way in which layers are put together. */
const GROUPED: KeyPicture = {
  layers: [
    layer("below"),
    { ...layer("paint"), parent: "group", blend: "multiply" },
    { ...layer("clipped"), parent: "group", clip: true, opacity: 0.5 },
    { ...layer("group"), group: true, opacity: 0.7 },
    { ...layer("inside"), parent: "through", blend: "multiply" },
    { ...layer("through"), group: true, blend: "pass-through", opacity: 0.8 },
  ],
  mask: layer("mask"),
};
const IDS = ["below", "paint"];

const tips = ALL_BRUSHES.flatMap(({ tip }) => (tip ? [tip] : []));
const color = fc.constantFrom("#c81e28", "#141e5a", "#f0e6c8");
const sample = fc.tuple(fc.nat(48), fc.nat(32), fc.constantFrom(0.3, 0.7, 1)).map((one): Sample => one);
const samples = fc.array(sample, { minLength: 1, maxLength: 4 });
const part = fc.record({
  samples,
  size: fc.constantFrom(2, 6, 14),
  opacity: fc.constantFrom(0.4, 1),
  seed: fc.nat(99),
});
const stroke: fc.Arbitrary<Stroke> = fc.oneof(
  fc
    .tuple(part, fc.constantFrom(...tips), fc.constantFrom("brush" as const, "eraser" as const), color)
    .map(([one, tip, kind, paint]): Stroke => ({ ...one, kind, tip, color: paint })),
  fc
    .tuple(part, fc.constantFrom(undefined, ...tips))
    .map(([one, tip]): Stroke => ({ ...one, kind: "smudge", ...(tip && { tip }) })),
  fc
    .tuple(color, fc.nat(1000), fc.integer({ min: 1, max: 400 }))
    .map(([paint, start, length]): Stroke => ({ kind: "fill", color: paint, opacity: 0.6, runs: [start, length] })),
);

const onLocked = fc
  .tuple(stroke, fc.boolean())
  .map(([one, locked]): Stroke => (one.kind === "transform" || !locked ? one : { ...one, locked }));

type Operation = "undo" | "redo" | { layer: string; stroke: Stroke; live: boolean } | { hide: string };
const operationOn = (ids: string[], strokes: fc.Arbitrary<Stroke>): fc.Arbitrary<Operation> =>
  fc.oneof(
    {
      weight: 5,
      arbitrary: fc.record({ layer: fc.constantFrom(...ids), stroke: strokes, live: fc.boolean() }),
    },
    { weight: 2, arbitrary: fc.constant("undo" as const) },
    { weight: 1, arbitrary: fc.constant("redo" as const) },
    { weight: 1, arbitrary: fc.record({ hide: fc.constantFrom(...ids) }) },
  );

const same = (a: Uint8ClampedArray, b: Uint8ClampedArray) =>
  a.length === b.length && a.every((value, i) => value === b[i]);

beforeEach(fakeCanvases);
afterEach(() => {
  vi.unstubAllGlobals();
});

/** Draw a stroke as the pen does: its samples arrive one after the other, and the stage is drawn each time. */
function drawLive(raster: PictureRaster, picture: KeyPicture, id: string, drawn: DrawnStroke): void {
  const growing: Sample[] = [];
  const live = { layer: id, stroke: { ...drawn, samples: growing } };
  for (const one of drawn.samples) {
    growing.push(one);
    raster.whole(KEY, picture, live);
  }
  (drawn as { samples: readonly Sample[] }).samples = growing;
}

/** Draw, undo and redo; now and then, what is shown is compared with a picture that is drawn anew. */
function checkOperations(first: KeyPicture, operation: fc.Arbitrary<Operation>, length: number): void {
  fc.assert(
    fc.property(fc.array(operation, { minLength: length, maxLength: length }), (operations) => {
      const raster = new PictureRaster(SIZE);
      let history: History<KeyPicture> = startHistory(first);
      const check = () => {
        const fresh = new PictureRaster(SIZE);
        const [kept, anew] = [raster.whole(KEY, history.present), fresh.whole(KEY, history.present)];
        expect(same(pixelsOf(kept), pixelsOf(anew))).toBe(true);
      };
      operations.forEach((one, i) => {
        const { present } = history;
        if (one === "undo") history = undo(history);
        else if (one === "redo") history = redo(history);
        else if ("hide" in one) {
          const hidden = changePictureLayer(present, one.hide, (found) => ({ ...found, visible: !found.visible }));
          history = record(history, "hide", hidden, { at: i });
        } else {
          const made = { ...one.stroke };
          if (one.live && "samples" in made) drawLive(raster, present, one.layer, made);
          history = record(history, "stroke", addStroke(present, one.layer, made), { at: i });
        }
        raster.whole(KEY, history.present);
        if (i % 50 === 49) check();
      });
      while (history.past.length) history = undo(history);
      check();
      const shown = pixelsOf(raster.whole(KEY, first));
      expect(same(shown, pixelsOf(new PictureRaster(SIZE).whole(KEY, first)))).toBe(true);
      if (!first.mask) expect(shown.every((value) => value === 0)).toBe(true);
      while (history.future.length) history = redo(history);
      check();
    }),
    { numRuns: 1 },
  );
}

test("500 random strokes, undos and redos leave the pixels of the strokes that are left", () => {
  checkOperations(FIRST, operationOn(IDS, stroke), 500);
}, 60_000);

test("so do those on layers in groups, clipped ones, masks, and layers whose opacity is locked", () => {
  checkOperations(GROUPED, operationOn([...IDS, "clipped", "inside", "mask"], onLocked), 250);
}, 60_000);

test("the stage shows what the film has, where the key counts", () => {
  const raster = new PictureRaster(SIZE);
  const { mask: _mask, ...shown } = GROUPED;
  fc.assert(
    fc.property(fc.constantFrom("below", "paint", "clipped", "inside"), onLocked, (id, one) => {
      const picture = addStroke(shown, id, one);
      if ("samples" in one) drawLive(raster, shown, id, one);
      const [canvas, context] = createCanvas(SIZE);
      raster.draw(context, KEY, picture);
      expect(same(pixelsOf(raster.whole(KEY, picture)), pixelsOf(canvas))).toBe(true);
    }),
    { numRuns: 40 },
  );
});

test("a stroke under the pen that is given up leaves nothing", () => {
  const raster = new PictureRaster(SIZE);
  const tip = tips[0];
  const live = {
    layer: "paint",
    stroke: {
      kind: "brush" as const,
      color: "#c81e28",
      size: 9,
      opacity: 1,
      tip,
      seed: 1,
      samples: [[20, 16, 1] as Sample],
    },
  };
  expect(pixelsOf(raster.whole(KEY, FIRST, live as never)).some((value) => value > 0)).toBe(true);
  expect(pixelsOf(raster.whole(KEY, FIRST)).every((value) => value === 0)).toBe(true);
});

test("one more sample changes the pixels around it only", () => {
  const raster = new PictureRaster(SIZE);
  const growing: Sample[] = [[6, 16, 1]];
  const stroke = {
    kind: "brush" as const,
    color: "#c81e28",
    size: 6,
    opacity: 1,
    tip: tips[1],
    seed: 1,
    samples: growing,
  };
  const live = { layer: "paint", stroke } as never;
  raster.whole(KEY, FIRST, live);
  growing.push([40, 16, 1]);
  raster.whole(KEY, FIRST, live);
  expect(raster.changed?.height).toBeLessThan(12);
  raster.whole(KEY, FIRST, live);
  expect(raster.changed).toBeNull();
});

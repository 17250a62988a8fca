/** Brushes: curves, stamps along recorded strokes, their paint, and that a stroke is the same whenever it is drawn. */

import { describe, expect, test } from "vitest";
import { ROUND, STEADY, type Tip } from "../../../src/studio/document/tip";
import { ALL_BRUSHES, BRUSHES } from "../../../src/studio/drawing/brushes";
import { valueAt } from "../../../src/studio/drawing/curves";
import { grain } from "../../../src/studio/drawing/noise";
import { Stabiliser } from "../../../src/studio/drawing/stabiliser";
import { type Stamp, StampPath } from "../../../src/studio/drawing/stamp-path";
import { boundsOf } from "../../../src/studio/drawing/stroke-drawing";
import { PaintBuffers, StrokeMask } from "../../../src/studio/drawing/stroke-mask";
import { strokesOfText, textOfStrokes } from "../../../src/studio/drawing/stroke-text";
import { type BrushStroke, rounded, type Sample, type Stroke } from "../../../src/studio/drawing/strokes";
import { tipPicture } from "../../../src/studio/drawing/tip-picture";

const SIZE = { width: 240, height: 120 };

/** Recorded with a pen: an arc with growing and falling pressure; it leans more and more to the lower right. */
const RECORDED: Sample[] = Array.from({ length: 60 }, (_, i): Sample => {
  const t = i / 59;
  const place: Sample = [30 + 180 * t, 60 - 30 * Math.sin(Math.PI * t), 0.1 + 0.9 * Math.sin(Math.PI * t), 60 * t, 45];
  return rounded(place);
});

function stampsOf(tip: Partial<Tip>, samples: readonly Sample[], size = 20, seed = 3): Stamp[] {
  const stamps: Stamp[] = [];
  const path = new StampPath({ ...ROUND, ...tip }, size, seed);
  for (const sample of samples) path.to(sample, (stamp) => stamps.push(stamp));
  path.end((stamp) => stamps.push(stamp));
  return stamps;
}

function strokeOf(
  tip: Partial<Tip>,
  samples: readonly Sample[] = RECORDED,
  more: Partial<BrushStroke> = {},
): BrushStroke {
  const stroke = { kind: "brush" as const, color: "#204080", size: 20, opacity: 1, seed: 3, samples };
  return { ...stroke, tip: { ...ROUND, ...tip }, ...more };
}

/** RGBA pixels of strokes on white or on nothing. */
function painted(strokes: readonly BrushStroke[], paper = 255, buffers = new PaintBuffers(SIZE)): Uint8ClampedArray {
  const data = new Uint8ClampedArray(4 * SIZE.width * SIZE.height).fill(paper);
  for (const stroke of strokes) {
    const mask = new StrokeMask(stroke, stroke.tip as Tip, buffers);
    for (const sample of stroke.samples) mask.to(sample);
    mask.end();
    mask.lay(data, { x: 0, y: 0, ...SIZE });
    mask.free();
  }
  return data;
}

const pixel = (data: Uint8ClampedArray, x: number, y: number) => [
  ...data.slice(4 * (y * SIZE.width + x), 4 * (y * SIZE.width + x) + 4),
];
const alphas = (data: Uint8ClampedArray) => data.filter((_, i) => i % 4 === 3);
const sum = (values: Iterable<number>) => [...values].reduce((all, value) => all + value, 0);
const line = (y = 60): Sample[] => [
  [30, y, 1],
  [210, y, 1],
];

describe("curves", () => {
  test("go through their three values, and stay between neighbouring ones", () => {
    for (const curve of [
      [0.2, 0.5, 1],
      [0, 0, 1],
      [1, 0.4, 0.4],
      [0, 1, 0],
    ] as const) {
      expect([0, 0.5, 1].map((at) => valueAt(curve, at))).toEqual([...curve]);
      for (let i = 0; i <= 100; i++) {
        const value = valueAt(curve, i / 100);
        const [a, b] = i < 50 ? [curve[0], curve[1]] : [curve[1], curve[2]];
        expect(value).toBeGreaterThanOrEqual(Math.min(a, b) - 1e-9);
        expect(value).toBeLessThanOrEqual(Math.max(a, b) + 1e-9);
      }
    }
  });

  test("of pressure and tilt set the size and the opacity of the stamps of a recorded stroke", () => {
    const size = { pressure: [0.2, 0.5, 1], tilt: [1, 1.5, 3] } as const;
    const opacity = { pressure: [0.1, 0.4, 1], tilt: [1, 1, 0.5] } as const;
    for (const stamp of stampsOf({ size, opacity }, RECORDED)) {
      const t = (stamp.x - 30) / 180;
      const pressure = 0.1 + 0.9 * Math.sin(Math.PI * t);
      expect(stamp.radius).toBeCloseTo(10 * valueAt(size.pressure, pressure) * valueAt(size.tilt, t), 0);
      expect(stamp.opacity).toBeCloseTo(Math.min(1, valueAt(opacity.pressure, pressure) * valueAt(opacity.tilt, t)), 1);
    }
  });
});

describe("the stabiliser", () => {
  const trembling = RECORDED.map(([x, y, pressure], i): Sample => [x, y + (i % 2 ? 2 : -2), pressure]);
  const steadied = (samples: readonly Sample[], length: number): Sample[] => {
    const stabiliser = new Stabiliser(length);
    const found = samples.map((sample) => stabiliser.to(sample)).filter((sample) => sample !== null);
    const end = stabiliser.end();
    return end ? [...found, end] : found;
  };
  const roughness = (samples: readonly Sample[]) =>
    sum(samples.slice(2).map(([, y], i) => Math.abs(y - 2 * (samples[i + 1]?.[1] ?? 0) + (samples[i]?.[1] ?? 0))));

  test("takes the tremor out of a stroke, and ends it where the pen is", () => {
    const steady = steadied(trembling, 12);
    expect(roughness(steady)).toBeLessThan(roughness(trembling) / 5);
    expect(steady.at(-1)).toEqual(trembling.at(-1));
    expect(steadied(trembling, 0)).toEqual(trembling);
  });

  test("does not move the brush while the pen stays within the string", () => {
    const stabiliser = new Stabiliser(10);
    stabiliser.to([50, 50, 1]);
    expect(stabiliser.to([57, 55, 1])).toBeNull();
    expect(stabiliser.to([70, 50, 1])).toEqual([60, 50, 1]);
  });
});

describe("stamps", () => {
  test("are evenly spaced, however the samples arrive", () => {
    const many = Array.from({ length: 181 }, (_, i): Sample => [30 + i, 60, 1]);
    const [few, fine] = [stampsOf({ spacing: 0.25 }, line()), stampsOf({ spacing: 0.25 }, many)];
    expect(few.map(({ x }) => x)).toEqual(Array.from({ length: 37 }, (_, i) => 30 + 5 * i));
    expect(fine.map(({ x }) => Math.round(1e6 * x))).toEqual(few.map(({ x }) => Math.round(1e6 * x)));
  });

  test("follow the stroke, the lean of the pen, or neither", () => {
    const down: Sample[] = [
      [50, 20, 1, 40, 30],
      [50, 90, 1, 40, 30],
    ];
    const angle = (turn: Tip["turn"]) => stampsOf({ turn, angle: 10 }, down).at(-1)?.angle ?? 0;
    expect(angle("path")).toBeCloseTo((100 * Math.PI) / 180);
    expect(angle("pen")).toBeCloseTo((40 * Math.PI) / 180);
    expect(angle("fixed")).toBeCloseTo((10 * Math.PI) / 180);
  });

  test("scatter and vary by the seed of the stroke alone", () => {
    const random = { scatter: 0.5, sizeJitter: 0.5, angleJitter: 1 };
    expect(stampsOf(random, RECORDED, 20, 5)).toEqual(stampsOf(random, RECORDED, 20, 5));
    expect(stampsOf(random, RECORDED, 20, 5)).not.toEqual(stampsOf(random, RECORDED, 20, 6));
    for (const { y } of stampsOf(random, line())) expect(Math.abs(y - 60)).toBeLessThanOrEqual(10);
  });

  test("of a dot are one, also of a brush that follows its path", () => {
    expect(stampsOf({ turn: "path" }, [[50, 50, 0.5]])).toHaveLength(1);
    expect(stampsOf({}, [[50, 50, 0.5]])).toHaveLength(1);
  });
});

describe("paint", () => {
  test("covers the width of the stroke with a soft rim of about one pixel", () => {
    const data = painted([strokeOf({ hardness: 1 }, line())]);
    expect(pixel(data, 120, 60)).toEqual([0x20, 0x40, 0x80, 255]);
    expect(pixel(data, 120, 47)).toEqual([255, 255, 255, 255]);
    const rim = [48, 49, 50, 51].map((y) => pixel(data, 120, y)[0] ?? 0);
    expect(rim.filter((red) => red > 0x20 && red < 255).length).toBeLessThanOrEqual(2);
  });

  test("is softer with less hardness, and thinner with less flow", () => {
    const beside = (tip: Partial<Tip>) => pixel(painted([strokeOf(tip, line())]), 120, 54)[0] ?? 0;
    expect(beside({ hardness: 0 })).toBeGreaterThan(beside({ hardness: 0.9 }) + 20);
    const middle = (tip: Partial<Tip>) => pixel(painted([strokeOf({ spacing: 0.5, ...tip }, line())]), 120, 60)[0] ?? 0;
    expect(middle({ flow: 0.2 })).toBeGreaterThan(middle({ flow: 1 }) + 20);
  });

  test("does not add up where a translucent stroke crosses itself, but where two strokes do", () => {
    const there: Sample[] = [...line(), [30, 60, 1]];
    const once = painted([strokeOf({}, line(), { opacity: 0.5 })]);
    const twice = painted([strokeOf({}, there, { opacity: 0.5 })]);
    expect(pixel(twice, 120, 60)).toEqual(pixel(once, 120, 60));
    const two = painted([strokeOf({}, line(), { opacity: 0.5 }), strokeOf({}, line(), { opacity: 0.5 })]);
    expect(pixel(two, 120, 60)[0]).toBeLessThan(pixel(once, 120, 60)[0] ?? 0);
  });

  test("stays on the heights of the grain: less pressure covers less of the paper", () => {
    const tip = {
      grain: "paper" as const,
      grainDepth: 1,
      opacity: { pressure: [0, 0.5, 1] as const, tilt: STEADY.tilt },
    };
    const covered = (pressure: number) => {
      const data = painted(
        [
          strokeOf(
            tip,
            line().map(([x, y]): Sample => [x, y, pressure]),
          ),
        ],
        0,
      );
      return alphas(data).filter((alpha) => alpha > 0).length;
    };
    expect(covered(0.3)).toBeLessThan(0.5 * covered(1));
    expect(covered(0.3)).toBeGreaterThan(0.05 * covered(1));
    const heights = grain("paper");
    expect(heights.filter((height) => height < 0.25).length / heights.length).toBeCloseTo(0.25, 1);
  });

  test("of a wash is darker at its rim than inside", () => {
    const data = painted([strokeOf({ hardness: 0, wet: 1 }, line(), { size: 60 })], 0);
    const rows = (from: number, until: number) =>
      sum(
        Array.from({ length: 80 }, (_, i) =>
          sum(Array.from({ length: until - from }, (_, j) => pixel(data, 80 + i, from + j)[3] ?? 0)),
        ),
      ) /
      (80 * (until - from));
    expect(rows(31, 35)).toBeGreaterThan(1.2 * rows(55, 65));
  });

  test("of bristles runs dry along the stroke, in streaks of light and dark", () => {
    const tip = { shape: "bristles" as const, turn: "path" as const, dry: 8, shade: 0.4 };
    const data = painted([strokeOf(tip, line())], 0);
    const amount = (from: number) =>
      sum(alphas(data).filter((_, i) => i % SIZE.width >= from && i % SIZE.width < from + 40));
    expect(amount(160)).toBeLessThan(0.6 * amount(40));
    const reds = new Set(Array.from({ length: 16 }, (_, i) => pixel(data, 60, 52 + i)[0]));
    expect(reds.size).toBeGreaterThan(4);
  });

  test("of an eraser is taken away", () => {
    const data = painted(
      [
        strokeOf({}, line()),
        strokeOf(
          {},
          [
            [120, 20, 1],
            [120, 100, 1],
          ],
          { kind: "eraser" },
        ),
      ],
      0,
    );
    expect(pixel(data, 120, 60)[3]).toBe(0);
    expect(pixel(data, 80, 60)[3]).toBe(255);
  });

  test("has the shape of a picture, which turns with the stamp", () => {
    const bar = new Uint8Array(32 * 8).fill(255);
    const tip = { shape: "picture" as const, picture: tipPicture(32, 8, bar), spacing: 2 };
    const dot: Sample[] = [[120, 60, 1]];
    const upright = painted([strokeOf({ ...tip, angle: 90 }, dot)], 0);
    const flat = painted([strokeOf(tip, dot)], 0);
    expect([pixel(flat, 127, 60)[3], pixel(flat, 120, 67)[3]]).toEqual([255, 0]);
    expect([pixel(upright, 127, 60)[3], pixel(upright, 120, 67)[3]]).toEqual([0, 255]);
  });
});

describe("every brush of the set", () => {
  test("has a name of its own", () => {
    expect(new Set(ALL_BRUSHES.map(({ name }) => name)).size).toBe(11);
  });

  for (const { name, tip, opacity } of BRUSHES)
    test(`${name} gives the same pixels again, whatever was drawn before, and stays within its bounds`, () => {
      const stroke = strokeOf(tip ?? {}, RECORDED, { opacity });
      const buffers = new PaintBuffers(SIZE);
      const first = painted([stroke], 0, buffers);
      painted([strokeOf({ shape: "bristles", shade: 1 })], 0, buffers);
      const stored = strokesOfText(textOfStrokes([stroke])) as BrushStroke[];
      expect(painted(stored, 0, buffers).every((value, i) => value === first[i])).toBe(true);
      const touched = [...alphas(first).keys()].filter((i) => first[4 * i + 3]);
      expect(touched.length).toBeGreaterThan(100);
      const { x, y, width, height } = boundsOf(stroke, SIZE) ?? { x: 0, y: 0, width: 0, height: 0 };
      const [columns, rows] = [touched.map((i) => i % SIZE.width), touched.map((i) => Math.floor(i / SIZE.width))];
      expect(Math.min(...columns)).toBeGreaterThanOrEqual(x);
      expect(Math.max(...columns)).toBeLessThan(x + width);
      expect(Math.min(...rows)).toBeGreaterThanOrEqual(y);
      expect(Math.max(...rows)).toBeLessThan(y + height);
    });
});

test("strokes are stored with each tip once, and strokes of earlier versions are read", () => {
  const tip = { ...ROUND, picture: "x".repeat(1000) };
  const plain: Stroke = { kind: "eraser", color: "#000000", size: 3, opacity: 1, samples: [[1, 2, 1]] };
  const strokes: Stroke[] = [
    strokeOf(tip),
    plain,
    strokeOf(tip),
    { kind: "fill", color: "#ffffff", opacity: 1, runs: [0, 4] },
  ];
  const shared = strokes.map((stroke) => ("tip" in stroke && stroke.tip ? { ...stroke, tip } : stroke));
  const text = textOfStrokes(shared);
  expect(text.split("x".repeat(1000))).toHaveLength(2);
  expect(strokesOfText(text)).toEqual(shared);
  expect(strokesOfText(JSON.stringify({ version: 1, strokes: [plain] }))).toEqual([plain]);
});

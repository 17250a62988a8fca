import { expect, test } from "vitest";
import type { Params, Section } from "../../../src/api/schemas";
import type { Design, StyleKey } from "../../../src/studio/document/design";
import * as styles from "../../../src/studio/regions/style-values";

const slider = (name: string, minimum: number, maximum: number, more = {}) => ({
  ...{ name, title: name, minimum, maximum, step: 1, about: "", basic: true, circular: false, param: "", by: "sum" },
  ...more,
});
const SECTION = {
  sliders: [
    slider("size", 2, 150, { param: "width", by: "factor" }),
    slider("hue", -180, 180, { circular: true, param: "turn" }),
    slider("value", -1, 1),
  ],
  styles: [
    { value: "oil", title: "Oil", values: { size: 20, hue: 0, value: 0.5 }, technique: { soft: 1, dry: 0 } },
    { value: "dots", title: "Dots", values: { size: 10, hue: 0, value: 0 }, technique: { soft: 0, dry: 0 } },
  ],
  style_param: "look",
} as unknown as Section;

const context = (keys: StyleKey[], params: Params = { look: "oil" }, more: Design = {}): styles.StyleContext => ({
  section: SECTION,
  design: { ...more, keys },
  params,
});

test("the layer's parameters change what names no style, within its range", () => {
  const own = context([], { look: "oil", width: 9, turn: 200 });
  expect(styles.styleOf(own).values).toEqual({ size: 150, hue: -160, value: 0.5 });
  expect(styles.styleOf(own, { region: "rest", frame: 0, style: "dots", set: { value: 1 } }).values).toEqual({
    size: 10,
    hue: 0,
    value: 1,
  });
});

test("film-wide numbers over time change the styles below them", () => {
  const keys: StyleKey[] = [
    { region: "rest", frame: 0, set: { value: 0 } },
    { region: "rest", frame: 10, set: { value: 1 } },
  ];
  const film = context(keys, {
    look: "oil",
    width: [
      [0, 1],
      [10, 3],
    ],
  });
  expect(styles.styleAt(film, "rest", 5)?.values).toEqual({ size: 40, hue: 0, value: 0.5 });
  expect(styles.keyHere(film, "rest", 5)?.key.set).toEqual({ value: 0.5 });
});

test("a style of one's own has its base below it", () => {
  const own = { mine: { base: "dots", size: 44, technique: { dry: 0.7 } } };
  expect(styles.styleOf(context([], undefined, { styles: own }), { region: "rest", frame: 0, style: "mine" })).toEqual({
    values: { size: 44, hue: 0, value: 0 },
    technique: { soft: 0, dry: 0.7 },
  });
});

test("numbers change between keys by the easing, hues the shorter way round, and are constant outside", () => {
  const keys: StyleKey[] = [
    { region: "rest", frame: 10, style: "oil", set: { hue: 170 }, ease: "in" },
    { region: "rest", frame: 20, style: "dots", set: { size: 90, hue: -170 } },
  ];
  const at = (frame: number) => styles.styleAt(context(keys), "rest", frame);
  expect(at(15)?.values).toEqual({ size: 28.75, hue: 172.5, value: 0.4375 });
  expect(at(15)?.technique).toEqual({ soft: 0.875, dry: 0 });
  expect(at(18)?.values.hue).toBeCloseTo(-179.76);
  expect([0, 10, 20, 30].map((frame) => at(frame)?.values.size)).toEqual([20, 20, 90, 90]);
  expect(styles.styleAt(context(keys), "other", 3)).toBeUndefined();
});

test("a new key between two keys of one style sets what differs from it", () => {
  const keys: StyleKey[] = [
    { region: "rest", frame: 0, style: "oil", set: { value: 1 } },
    { region: "rest", frame: 10, style: "oil", set: { size: 40 }, ease: "smooth" },
  ];
  const made = styles.keyHere(context(keys), "rest", 5);
  expect(made).toEqual({ key: { ...keys[0], frame: 5, set: { size: 30, value: 0.75 } }, styles: undefined });
});

test("a new key between two styles has a style of its own, and the film's values", () => {
  const keys: StyleKey[] = [
    { region: "rest", frame: 0, style: "oil" },
    { region: "rest", frame: 10, style: "dots" },
  ];
  const before = context(keys);
  const made = styles.keyHere(before, "rest", 4);
  expect(made?.key).toEqual({ region: "rest", frame: 4, style: "mix", set: {} });
  const design = { keys: [...keys, made?.key as StyleKey], styles: made?.styles };
  const after = styles.styleOf({ ...before, design }, made?.key);
  expect(after).toEqual(styles.styleAt(before, "rest", 4));
  expect(styles.withoutUnusedMixes(design)).toBe(design);
  expect(styles.withoutUnusedMixes({ ...design, keys }).styles).toEqual({});
});

test("a key that exists stays as it is", () => {
  const keys: StyleKey[] = [{ region: "rest", frame: 3, set: { size: 7 }, ease: "hold" }];
  expect(styles.keyHere(context(keys), "rest", 3)?.key).toEqual(keys[0]);
  expect(styles.keyHere(context(keys), "rest", 9)?.key).toEqual({ ...keys[0], frame: 9 });
  expect(styles.keyHere(context(keys), "other", 3)).toBeUndefined();
});

/** Blend modes of paint layers, as W3C Compositing and Blending Level 1 has them: the canvas and the service agree. */

import type { PaintLayer } from "../document/document";

export type PaintBlend = NonNullable<PaintLayer["blend"]>;

/** Modes of the menu with their titles; "pass-through" is one of groups only. */
export const BLENDS: readonly (readonly [PaintBlend, string])[] = [
  ["over", "Normal"],
  ["darken", "Darken"],
  ["multiply", "Multiply"],
  ["color-burn", "Colour burn"],
  ["lighten", "Lighten"],
  ["screen", "Screen"],
  ["color-dodge", "Colour dodge"],
  ["overlay", "Overlay"],
  ["soft-light", "Soft light"],
  ["hard-light", "Hard light"],
  ["difference", "Difference"],
  ["exclusion", "Exclusion"],
  ["hue", "Hue"],
  ["saturation", "Saturation"],
  ["color", "Colour"],
  ["luminosity", "Luminosity"],
];

const OTHER: Partial<Record<PaintBlend, GlobalCompositeOperation>> = {
  over: "source-over",
  "pass-through": "source-over",
  add: "lighter",
};

/** What the canvas calls a mode. */
export const operationOf = (blend: PaintBlend = "over"): GlobalCompositeOperation =>
  OTHER[blend] ?? (blend as GlobalCompositeOperation);

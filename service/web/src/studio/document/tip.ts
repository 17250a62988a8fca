/** The settings of a brush's stamps as data. Colour, size and opacity are the stroke's own. */

/** Values at 0, a half and 1; between them the curve is smooth and does not leave the range of its ends. */
export type Curve = readonly [number, number, number];

export const GRAINS = ["paper", "rough", "canvas"] as const;
/** "paper": fine tooth; "rough": hand-made watercolour paper; "canvas": woven threads. */
export type GrainName = (typeof GRAINS)[number];

/** How much of a quantity is used, by the pen's pressure and by its tilt (1: 60 degrees or more); both are multiplied. */
export interface Dynamics {
  /** Values 0..1. */
  pressure: Curve;
  /** Factors of 0 or more. */
  tilt: Curve;
}

export interface Tip {
  /** "picture": the alpha of `picture`. */
  shape: "round" | "bristles" | "picture";
  /** A gray PNG, base64: white is paint. */
  picture?: string;
  /** Share of the radius within which a round stamp is full, 0..1. */
  hardness: number;
  /** Short by long axis, 0.05..1. */
  roundness: number;
  /** Of the long axis, degrees clockwise. */
  angle: number;
  /** What the angle is counted from: the picture's right, the direction of the stroke, or that in which the pen leans. */
  turn: "fixed" | "path" | "pen";
  /** Distance between stamps, in widths of a stamp, 0.02..2. */
  spacing: number;
  /** Share of the missing paint that one stamp adds, 0..1. */
  flow: number;
  /** Largest offset of a stamp from the stroke, in widths. */
  scatter: number;
  /** Random part of the size, 0..1. */
  sizeJitter: number;
  /** Random part of the angle, 0..1 of a full turn. */
  angleJitter: number;
  grain: GrainName | "none";
  /** How deep the valleys are that paint does not reach, 0..1. */
  grainDepth: number;
  grainScale: 1 | 2 | 4;
  /** How dark the rim of a wash is, 0..1; 0: the paint is not wet. */
  wet: number;
  /** How much bristles differ in lightness, 0..1. */
  shade: number;
  /** Widths of the stroke after which bristles have run dry; 0: never. */
  dry: number;
  size: Dynamics;
  opacity: Dynamics;
  flowBy: Dynamics;
}

const FULL: Curve = [1, 1, 1];

export const STEADY: Dynamics = { pressure: FULL, tilt: FULL };

/** A hard round stamp; the brushes of the set are told by how they differ from it. */
export const ROUND: Tip = {
  shape: "round",
  hardness: 0.95,
  roundness: 1,
  angle: 0,
  turn: "fixed",
  spacing: 0.06,
  flow: 1,
  scatter: 0,
  sizeJitter: 0,
  angleJitter: 0,
  grain: "none",
  grainDepth: 0,
  grainScale: 1,
  wet: 0,
  shade: 0,
  dry: 0,
  size: STEADY,
  opacity: STEADY,
  flowBy: STEADY,
};

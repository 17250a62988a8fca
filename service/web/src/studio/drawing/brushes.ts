/** The set of brushes. Each is told by how its stamps differ from a hard round one. */

import { ROUND, STEADY, type Tip } from "../document/tip";

export interface BrushPreset {
  name: string;
  /** Absent: a plain round line. */
  tip?: Tip;
  /** Width at full pressure, px of a video of 1080 lines. */
  size: number;
  /** 0..1 */
  opacity: number;
}

const preset = (name: string, size: number, opacity: number, tip: Partial<Tip>): BrushPreset => ({
  name,
  size,
  opacity,
  tip: { ...ROUND, ...tip },
});

/** A line without texture, whose width follows the pressure. */
export const PLAIN: BrushPreset = { name: "Round", size: 24, opacity: 1 };

export const BRUSHES: readonly BrushPreset[] = [
  preset("Pencil", 5, 0.85, {
    hardness: 0.5,
    spacing: 0.12,
    flow: 0.75,
    sizeJitter: 0.15,
    grain: "paper",
    grainDepth: 0.8,
    size: { pressure: [0.55, 0.8, 1], tilt: [1, 2, 6] },
    opacity: { pressure: [0.15, 0.6, 0.95], tilt: [1, 0.85, 0.6] },
  }),
  preset("Ink pen", 7, 1, {
    hardness: 1,
    spacing: 0.05,
    size: { pressure: [0.25, 0.6, 1], tilt: [1, 1, 1] },
  }),
  preset("Brush pen", 26, 1, {
    hardness: 0.9,
    roundness: 0.75,
    angle: 45,
    spacing: 0.03,
    grain: "rough",
    grainDepth: 0.35,
    size: { pressure: [0.03, 0.35, 1], tilt: [1, 1, 1.2] },
    opacity: { pressure: [0.6, 0.95, 1], tilt: [1, 1, 1] },
  }),
  preset("Marker", 34, 0.65, {
    hardness: 0.92,
    roundness: 0.4,
    angle: -40,
    spacing: 0.03,
    grain: "paper",
    grainDepth: 0.25,
    opacity: { pressure: [0.75, 0.9, 1], tilt: [1, 1, 1] },
  }),
  preset("Gouache", 46, 0.95, {
    shape: "bristles",
    hardness: 0.85,
    roundness: 0.7,
    turn: "path",
    spacing: 0.04,
    flow: 0.8,
    shade: 0.05,
    dry: 24,
    size: { pressure: [0.5, 0.8, 1], tilt: [1, 1, 1] },
    opacity: { pressure: [0.5, 0.9, 1], tilt: [1, 1, 1] },
  }),
  preset("Oil", 54, 1, {
    shape: "bristles",
    hardness: 0.6,
    roundness: 0.5,
    turn: "path",
    spacing: 0.03,
    flow: 0.6,
    grain: "canvas",
    grainDepth: 0.22,
    shade: 0.3,
    dry: 40,
    size: { pressure: [0.6, 0.85, 1], tilt: [1, 1, 1] },
    opacity: { pressure: [0.55, 0.9, 1], tilt: [1, 1, 1] },
  }),
  preset("Watercolour", 60, 0.7, {
    hardness: 0,
    spacing: 0.05,
    wet: 1,
    size: { pressure: [0.15, 0.6, 1], tilt: [1, 1, 1] },
  }),
  preset("Pastel", 40, 0.95, {
    hardness: 0.7,
    roundness: 0.8,
    spacing: 0.08,
    flow: 0.35,
    scatter: 0.03,
    sizeJitter: 0.2,
    angleJitter: 1,
    grain: "rough",
    grainDepth: 0.85,
    size: { pressure: [0.7, 0.9, 1], tilt: [1, 1, 1.6] },
    opacity: { pressure: [0.25, 0.65, 1], tilt: [1, 1, 0.8] },
  }),
  preset("Charcoal", 24, 0.95, {
    hardness: 0.45,
    roundness: 0.6,
    turn: "pen",
    spacing: 0.1,
    flow: 0.3,
    scatter: 0.1,
    sizeJitter: 0.4,
    angleJitter: 0.3,
    grain: "paper",
    grainDepth: 0.95,
    size: { pressure: [0.5, 0.8, 1], tilt: [1, 1.8, 4] },
    opacity: { pressure: [0.3, 0.7, 1], tilt: [1, 0.95, 0.8] },
  }),
  preset("Airbrush", 120, 0.9, {
    hardness: 0,
    spacing: 0.06,
    flow: 0.12,
    flowBy: { pressure: [0.1, 0.45, 1], tilt: STEADY.tilt },
    opacity: { pressure: [0.5, 0.8, 1], tilt: STEADY.tilt },
  }),
];

/** All brushes: the plain one first. */
export const ALL_BRUSHES: readonly BrushPreset[] = [PLAIN, ...BRUSHES];

/** Strokes as JSON: tips, which many strokes share, are stored once. */

import type { Tip } from "../document/tip";
import type { Stroke } from "./strokes";

interface StrokesFile {
  version: 1 | 2;
  /** Tips of the strokes, which have their numbers. Absent in version 1. */
  tips?: Tip[];
  strokes: (Omit<Stroke, "tip"> & { tip?: number })[];
}

export function textOfStrokes(strokes: readonly Stroke[]): string {
  const tips: Tip[] = [];
  const numbered = strokes.map((stroke) => {
    if (!("tip" in stroke) || !stroke.tip) return stroke;
    if (!tips.includes(stroke.tip)) tips.push(stroke.tip);
    return { ...stroke, tip: tips.indexOf(stroke.tip) };
  });
  return JSON.stringify({ version: 2, tips, strokes: numbered });
}

export function strokesOfText(text: string): readonly Stroke[] {
  const { tips = [], strokes } = JSON.parse(text) as StrokesFile;
  return strokes.map((stroke) => (stroke.tip === undefined ? stroke : { ...stroke, tip: tips[stroke.tip] }) as Stroke);
}

/** The interface of a tool of the stage, which handles the pointer. Positions are pixels of the video. */

import type { Point } from "../document/document";
import type { Sample } from "../drawing/strokes";

export interface PointerSample {
  at: Point;
  /** 0..1; 1 for pointers without pressure. */
  pressure: number;
  /** From upright, and the direction in which the pen leans, clockwise from the right; degrees. */
  tilt?: number;
  lean?: number;
  shift: boolean;
  alt: boolean;
}

export interface StageTool {
  /** The pointer was pressed; false if the tool does not use it, so that the stage pans. */
  down(sample: PointerSample): boolean;
  /** The pointer moved while pressed: all samples since the last call, in order. */
  move(samples: readonly PointerSample[]): void;
  up(): void;
  /** End the action under the pointer without an effect: it was the first finger of two. Without it, `up` is called. */
  cancel?(): void;
  /** The pointer moved without being pressed; null: it left the stage. */
  hover?(sample: PointerSample | null): void;
  /** Draw over the picture; the context is in pixels of the video, `px` is one CSS pixel in those. */
  draw?(context: CanvasRenderingContext2D, px: number): void;
  cursor: string;
}

export const sampleOf = ({ at, pressure, tilt, lean }: PointerSample): Sample =>
  tilt ? [at[0], at[1], pressure, tilt, lean ?? 0] : [at[0], at[1], pressure];

/** Steadies a hand: the brush is pulled by the pen on a string, so that tremor shorter than the string leaves no trace. */

import type { Sample } from "./strokes";

export class Stabiliser {
  private at: Sample | null = null;
  private pen: Sample | null = null;

  /** `length` of the string, px of the picture; 0 changes nothing. */
  constructor(private readonly length: number) {}

  /** The brush's next sample; null while the string is slack. */
  to(sample: Sample): Sample | null {
    this.pen = sample;
    const { at, length } = this;
    if (!at || !length) {
      this.at = sample;
      return sample;
    }
    const [dx, dy] = [sample[0] - at[0], sample[1] - at[1]];
    const far = Math.sqrt(dx * dx + dy * dy);
    if (far <= length) return null;
    const share = 1 - length / far;
    const moved: Sample = [...sample];
    moved[0] = at[0] + share * dx;
    moved[1] = at[1] + share * dy;
    this.at = moved;
    return moved;
  }

  /** Where the pen is, for the end of the stroke; null if the brush is there. */
  end(): Sample | null {
    return this.pen === this.at ? null : this.pen;
  }
}

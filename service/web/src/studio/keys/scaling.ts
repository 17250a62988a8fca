/** How a picture of another size is laid on the video's frame. */

import type { Size } from "../drawing/geometry";
import type { Box } from "../drawing/transform";

/**
 * "fit": the whole picture, the rest stays unpainted; "fill": the whole frame, what is too much is cut off; "stretch":
 * the whole picture on the whole frame; "exact": pixel for pixel, both centred.
 */
export type Scaling = "fit" | "fill" | "stretch" | "exact";

export const SCALINGS: readonly (readonly [Scaling, string, string])[] = [
  ["fit", "Fit", "The whole picture is seen; what is beside it stays unpainted."],
  ["fill", "Fill", "The whole frame is covered; what is too much is cut off."],
  ["stretch", "Stretch", "The whole picture on the whole frame; its proportions change."],
  ["exact", "Pixel for pixel", "Not scaled, in the middle of the frame."],
];

/** Where a picture lies on a frame, px. */
export function placed(picture: Size, frame: Size, scaling: Scaling): Box {
  const [across, down] = [frame.width / picture.width, frame.height / picture.height];
  const factor = { fit: Math.min(across, down), fill: Math.max(across, down), stretch: 0, exact: 1 }[scaling];
  const width = scaling === "stretch" ? frame.width : Math.round(picture.width * factor);
  const height = scaling === "stretch" ? frame.height : Math.round(picture.height * factor);
  return { x: Math.floor((frame.width - width) / 2), y: Math.floor((frame.height - height) / 2), width, height };
}

export const sameSize = (a: Size, b: Size): boolean => a.width === b.width && a.height === b.height;

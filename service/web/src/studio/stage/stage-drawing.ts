/** What the stage draws and measures without a state of its own. */

import { toStage, type View } from "../drawing/geometry";
import type { Rect } from "../drawing/rect";
import type { Store } from "../state/store";

interface PartOptions {
  /** Only right of the divider, which is drawn. */
  split: boolean;
  /** 0..1 */
  alpha: number;
}

/** Draw a picture over the frame; the context is in pixels of the video. */
export function drawPart(
  context: CanvasRenderingContext2D,
  picture: CanvasImageSource,
  store: Store,
  { split, alpha }: PartOptions,
): void {
  const { width, height } = store.size;
  const from = split ? store.split.value * width : 0;
  context.save();
  context.globalAlpha = alpha;
  context.beginPath();
  context.rect(from, 0, width - from, height);
  context.clip();
  context.drawImage(picture, 0, 0, width, height);
  context.restore();
  if (split) drawDivider(context, from, height, 1 / store.view.value.scale);
}

/** `px`: one CSS pixel in those of the video. */
function drawDivider(context: CanvasRenderingContext2D, x: number, height: number, px: number): void {
  context.fillStyle = "#fff";
  context.fillRect(x - px, 0, 2 * px, height);
  context.beginPath();
  context.arc(x, height / 2, 12 * px, 0, 2 * Math.PI);
  context.fill();
}

/** The whole pixels of the canvas that show a part of the picture. */
export function onCanvas({ x, y, width, height }: Rect, view: View, ratio: number): Rect {
  const corners = [0, width].flatMap((dx) => [0, height].map((dy) => toStage(view, [x + dx, y + dy])));
  const [xs, ys] = [corners.map((corner) => corner[0] * ratio), corners.map((corner) => corner[1] * ratio)];
  const margin = 1 + Math.ceil(ratio * view.scale); // pixels beside it are mixed with it
  const [left, top] = [Math.floor(Math.min(...xs)) - margin, Math.floor(Math.min(...ys)) - margin];
  const [right, bottom] = [Math.ceil(Math.max(...xs)) + margin, Math.ceil(Math.max(...ys)) + margin];
  return { x: left, y: top, width: right - left, height: bottom - top };
}

/** How a pen leans, as the picture is turned; nothing if it stands upright or does not tell. */
export function tiltOf(
  { tiltX, tiltY }: PointerEvent,
  { turn = 0, mirrored = false }: View,
): { tilt?: number; lean?: number } {
  const [x, y] = [Math.tan((tiltX * Math.PI) / 180), Math.tan((tiltY * Math.PI) / 180)];
  if (!x && !y) return {};
  const lean = (Math.atan2(y, x) * 180) / Math.PI - turn;
  return { tilt: (Math.atan(Math.hypot(x, y)) * 180) / Math.PI, lean: ((mirrored ? 180 - lean : lean) + 720) % 360 };
}

/** Finds the area of a fill beside the page: for 1080p, it takes longer than the time between two frames. */

import { type FillOptions, floodRuns } from "./fill";
import { answerCalls } from "./worker-calls";

export interface FillRequest {
  picture: ImageBitmap;
  start: readonly [number, number];
  options: FillOptions;
}

answerCalls(({ picture, start, options }: FillRequest): number[] => {
  const { width, height } = picture;
  const context = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
  if (!context) throw new Error("There is no canvas.");
  context.drawImage(picture, 0, 0);
  picture.close();
  return floodRuns(context.getImageData(0, 0, width, height).data, { width, height }, start, options);
});

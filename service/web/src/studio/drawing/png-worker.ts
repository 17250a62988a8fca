/** Encodes pictures as PNG beside the page: on the page's own thread, browsers wait for idle time, up to a second. */

import { answerCalls } from "./worker-calls";

answerCalls((picture: ImageBitmap): Promise<Blob> => {
  const canvas = new OffscreenCanvas(picture.width, picture.height);
  canvas.getContext("2d")?.drawImage(picture, 0, 0);
  picture.close();
  return canvas.convertToBlob({ type: "image/png" });
});

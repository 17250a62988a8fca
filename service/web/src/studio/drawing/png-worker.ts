/** Encodes pictures as PNG beside the page: on the page's own thread, browsers wait for idle time, up to a second. */

export interface EncodeRequest {
  id: number;
  picture: ImageBitmap;
}

export interface EncodeAnswer {
  id: number;
  /** Absent if the browser could not encode. */
  blob?: Blob;
}

self.onmessage = async ({ data: { id, picture } }: MessageEvent<EncodeRequest>) => {
  const answer: EncodeAnswer = { id };
  try {
    const canvas = new OffscreenCanvas(picture.width, picture.height);
    canvas.getContext("2d")?.drawImage(picture, 0, 0);
    picture.close();
    answer.blob = await canvas.convertToBlob({ type: "image/png" });
  } finally {
    self.postMessage(answer);
  }
};

/** Pictures below the strokes of painted keys: frames of the video, and uploaded images. Each is loaded once. */

import * as api from "../../api/api";
import type { PictureRaster } from "../drawing/raster";
import type { KeyPicture } from "../drawing/strokes";
import { aborted, copyFrame, type FrameSource } from "../previews/frames";
import type { Store } from "../state/store";

/** The layer that shows the video's own frame below the strokes. */
export const FRAME_LAYER = "frame";
/** How often to look, every 30 ms, whether the stage shows the frame: a seek in a long video takes a second or more. */
const SHOWN_TRIES = 300;
const LOOK_MS = 30;

/** False once no caller waits for the picture. */
export type Wanted = () => boolean;

const always: Wanted = () => true;

export const baseOf = (layer: string, frame: number): string => `${FRAME_LAYER}:${layer}:${frame}`;

interface Loading {
  wants: Wanted[];
  done: Promise<void>;
}

export class Bases {
  private readonly loading = new Map<string, Loading>();

  constructor(
    private readonly store: Store,
    private readonly frames: FrameSource,
    private readonly raster: PictureRaster,
  ) {}

  /** Run `work` with all pictures below the strokes of `picture` loaded. */
  async with<T>(picture: KeyPicture, work: () => Promise<T>): Promise<T> {
    const release = this.raster.hold(picture.layers.map((layer) => layer.base));
    try {
      await this.load(picture);
      return await work();
    } finally {
      release();
    }
  }

  /** Load the missing pictures. Throws an AbortError once they are no longer needed. */
  async load(picture: KeyPicture, wanted = always): Promise<void> {
    for (const { base } of picture.layers) {
      if (!wanted()) throw aborted();
      if (base && !this.raster.hasBase(base)) await this.loadOne(base, wanted);
    }
  }

  /** Load a picture once, however many wait for it; it is given up when none of them wants it any more. */
  private loadOne(base: string, wanted: Wanted): Promise<void> {
    const begun = this.loading.get(base);
    if (begun) {
      begun.wants.push(wanted);
      return begun.done;
    }
    const wants = [wanted];
    const load = async () => {
      this.raster.setBase(base, await this.picture(base, () => wants.some((one) => one())));
    };
    const done = load().finally(() => this.loading.delete(base));
    this.loading.set(base, { wants, done });
    return done;
  }

  private async picture(base: string, wanted: Wanted): Promise<ImageBitmap> {
    if (!base.startsWith(`${FRAME_LAYER}:`)) return readPicture(base);
    const frame = Number(base.split(":").at(-1));
    const coming = () => this.store.frame.peek() === frame && this.frames.shown !== frame;
    for (let tries = 0; coming() && tries < SHOWN_TRIES; tries++)
      await new Promise((done) => setTimeout(done, LOOK_MS));
    return this.frames.shown === frame ? this.frames.copy() : copyFrame(this.store.asset, frame, wanted);
  }
}

/** The bytes of an image asset as a picture. */
async function readPicture(asset: string): Promise<ImageBitmap> {
  return createImageBitmap(await (await api.request(api.paths.content(asset))).blob());
}

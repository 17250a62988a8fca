/**
 * Pictures below the strokes of painted keys: frames of the video, painted frames, uploaded images, masks. Each is loaded
 * once.
 */

import * as api from "../../api/api";
import { notifyOf } from "../../ui/notices";
import { upload } from "../../ui/upload";
import { isPassing } from "../document/autosave";
import { pngOf } from "../drawing/png";
import { basesOf, createCanvas, type PictureRaster } from "../drawing/raster";
import type { KeyPicture } from "../drawing/strokes";
import { aborted, copyFrame, type FrameSource } from "../previews/frames";
import type { Store } from "../state/store";

/** The layer that shows the video's own frame below the strokes. */
export const FRAME_LAYER = "frame";
/** The layer that shows the frame as the film has it without the key. */
export const LOOK_LAYER = "result";
const LOOK = "look";
const GRAY = "gray";
/** How often to look, every 30 ms, whether the stage shows the frame: a seek in a long video takes a second or more. */
const SHOWN_TRIES = 300;
const LOOK_MS = 30;

/** False once no caller waits for the picture. */
export type Wanted = () => boolean;

const always: Wanted = () => true;

export const baseOf = (layer: string, frame: number): string => `${FRAME_LAYER}:${layer}:${frame}`;
/** The painted frame of a layer; `number` tells one from those that were made before. */
export const lookOf = (layer: string, frame: number, number: number): string => `${LOOK}:${number}:${layer}:${frame}`;
/** A gray picture whose brightness is opacity. */
export const grayOf = (asset: string): string => `${GRAY}:${asset}`;

interface Loading {
  wants: Wanted[];
  done: Promise<void>;
}

export class Bases {
  /** Paints a frame of the selected layer as the film has it without a key there; null: the service cannot. */
  paint: ((frame: number) => Promise<Blob>) | null = null;
  private readonly loading = new Map<string, Loading>();
  /** Asset ids of pictures that were made here. */
  private readonly made = new Map<string, Promise<string>>();
  /** Painted frames that are asked for, or are at full size already. */
  private readonly looks = new Set<string>();

  constructor(
    private readonly store: Store,
    private readonly frames: FrameSource,
    private readonly raster: PictureRaster,
    /** A painted frame has come, at full size. */
    private readonly onlook: (base: string) => void,
  ) {}

  /** Run `work` with all pictures below the strokes of `picture` loaded. */
  async with<T>(picture: KeyPicture, work: () => Promise<T>): Promise<T> {
    const release = this.raster.hold(basesOf(picture));
    try {
      await this.load(picture);
      return await work();
    } finally {
      release();
    }
  }

  /** Load the missing pictures. Throws an AbortError once they are no longer needed. */
  async load(picture: KeyPicture, wanted = always): Promise<void> {
    for (const base of basesOf(picture)) {
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
    const kind = base.split(":")[0];
    if (kind === GRAY) return brightnessAsOpacity(await readPicture(base.slice(GRAY.length + 1)));
    if (kind !== FRAME_LAYER && kind !== LOOK) return readPicture(base);
    const frame = Number(base.split(":").at(-1));
    const known = kind === LOOK ? await this.made.get(base) : null;
    if (known) return readPicture(known);
    const shown = kind === LOOK ? this.store.results.peek().get(frame) : undefined;
    if (shown && this.isOwn(shown.layer)) {
      const exact = shown.scale > 0.999 && this.store.presentResult(frame) === shown;
      if (exact) this.looks.add(base);
      return this.atFullSize(shown.picture);
    }
    return this.videoFrame(frame, wanted);
  }

  private async videoFrame(frame: number, wanted: Wanted): Promise<ImageBitmap> {
    const coming = () => this.store.frame.peek() === frame && this.frames.shown !== frame;
    for (let tries = 0; coming() && tries < SHOWN_TRIES; tries++)
      await new Promise((done) => setTimeout(done, LOOK_MS));
    return this.frames.shown === frame ? this.frames.copy() : copyFrame(this.store.asset, frame, wanted);
  }

  /** Whether a preview shows the selected layer alone: of the layer, or of a shot that has no other one. */
  private isOwn(layer: string | undefined): boolean {
    const { id } = this.store.layer.peek();
    return (layer ?? id) === id && Boolean(layer || this.store.shot.peek().layers.length === 1);
  }

  private async atFullSize(picture: ImageBitmap): Promise<ImageBitmap> {
    const [canvas, context] = createCanvas(this.store.size);
    context.imageSmoothingQuality = "high";
    context.drawImage(picture, 0, 0, canvas.width, canvas.height);
    return createImageBitmap(canvas);
  }

  /** The asset of a picture as it is shown now; null: it is the video's own frame. What the page has made is uploaded. */
  assetOf(base: string): Promise<string | null> {
    const kind = base.split(":")[0];
    if (kind === FRAME_LAYER) return Promise.resolve(null);
    return kind === LOOK || kind === GRAY ? this.fixed(base) : Promise.resolve(base);
  }

  /** The picture as an asset of its own, also if it is the video's frame: it may be used at another frame. */
  fixed(base: string): Promise<string> {
    if (base.startsWith("ast_")) return Promise.resolve(base);
    const known = this.made.get(base) ?? this.uploaded(base);
    this.made.set(base, known);
    known.catch(() => this.made.delete(base));
    return known;
  }

  private async uploaded(base: string): Promise<string> {
    if (!this.raster.hasBase(base)) await this.loadOne(base, always);
    const [canvas, context] = createCanvas(this.store.size);
    this.raster.drawBase(context, base);
    const png = await pngOf(canvas);
    const { id } = await upload(new File([png], `${base.replaceAll(":", "-")}.png`, { type: "image/png" }));
    this.raster.setBase(id, await createImageBitmap(png));
    return id;
  }

  /** Paint the frames below a key at full size; each is shown, and part of the key, as soon as it is painted. */
  prepare(picture: KeyPicture): void {
    for (const base of basesOf(picture)) if (base?.startsWith(`${LOOK}:`)) this.paintLook(base);
  }

  private async paintLook(base: string): Promise<void> {
    if (!this.paint || this.looks.has(base)) return;
    this.looks.add(base);
    try {
      const picture = await createImageBitmap(await this.paint(Number(base.split(":").at(-1))));
      this.raster.setBase(base, picture);
      this.made.delete(base);
      this.onlook(base);
    } catch (error) {
      const problem = api.isAbort(error) ? null : api.asProblem(error);
      if (!problem || isPassing(problem)) this.looks.delete(base);
      else notifyOf({ title: "The key lies over the frame as it was shown", ...textOf(problem) });
    }
  }
}

const textOf = ({ message, remedy }: api.Problem) => ({ message, remedy });

/** The bytes of an image asset as a picture. */
export async function readPicture(asset: string): Promise<ImageBitmap> {
  return createImageBitmap(await (await api.request(api.paths.content(asset))).blob());
}

async function brightnessAsOpacity(picture: ImageBitmap): Promise<ImageBitmap> {
  const [canvas, context] = createCanvas(picture);
  context.drawImage(picture, 0, 0);
  const image = context.getImageData(0, 0, picture.width, picture.height);
  for (let i = 0; i < image.data.length; i += 4) image.data.set([255, 255, 255, image.data[i] ?? 0], i);
  context.putImageData(image, 0, 0);
  return createImageBitmap(canvas);
}

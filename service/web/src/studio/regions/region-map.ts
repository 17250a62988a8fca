/** The region of each pixel of the shown frame as the film has it; what is not selected is dimmed. */

import { pictureOf } from "../document/api";
import { REST } from "../document/design";
import type { Point } from "../document/document";
import type { PreviewRecord } from "../document/records";
import { createCanvas } from "../drawing/raster";
import type { Store, Tool } from "../state/store";
import { FilmView } from "./film-view";

/** Tools with which the stage dims what is not selected. */
const REGION_TOOLS: readonly Tool[] = ["region", "lasso", "correct", "direction"];
const DIM = [12, 9, 7, 130] as const;

export interface RegionMap {
  width: number;
  height: number;
  /** Index of `names` of each pixel. */
  regions: Uint8Array;
  names: readonly string[];
}

export class RegionMaps {
  readonly view: FilmView<RegionMap>;
  private overlay: { map: RegionMap; region: string; canvas: HTMLCanvasElement } | null = null;

  constructor(
    private readonly store: Store,
    redraw: () => void,
  ) {
    const wanted = () =>
      REGION_TOOLS.includes(store.tool.value) && Object.keys(store.design.regions ?? {}).some((name) => name !== REST);
    const options = { film: true };
    this.view = new FilmView(
      store,
      { what: "regions", channel: "region-map", options, wanted, of: ["regions", "corrections"], read: readMap },
      redraw,
    );
  }

  /** The region at a point of the picture; undefined as long as the service has not found it. */
  regionAt([x, y]: Point): string | undefined {
    const map = this.view.present;
    if (!map) return undefined;
    const column = Math.floor((x / this.store.size.width) * map.width);
    const row = Math.floor((y / this.store.size.height) * map.height);
    if (column < 0 || row < 0 || column >= map.width || row >= map.height) return undefined;
    return map.names[map.regions[row * map.width + column] ?? 0];
  }

  /** Dim all other regions than the selected one; until the service has the map, what is outside the region's outlines
   * in this frame. The context is in pixels of the video. */
  draw(context: CanvasRenderingContext2D): void {
    const { region, size } = this.store;
    if (!region.value || !REGION_TOOLS.includes(this.store.tool.value)) return;
    const map = this.view.present;
    if (!map) {
      this.dimOutside(context);
      return;
    }
    if (this.overlay?.map !== map || this.overlay.region !== region.value) {
      const index = map.names.indexOf(region.value);
      this.overlay = { map, region: region.value, canvas: veil(map, (i) => map.regions[i] !== index) };
    }
    context.imageSmoothingEnabled = false;
    context.drawImage(this.overlay.canvas, 0, 0, size.width, size.height);
    context.imageSmoothingEnabled = true;
  }

  private dimOutside(context: CanvasRenderingContext2D): void {
    const { width, height } = this.store.size;
    const outlines = this.store.design.regions?.[this.store.region.value]?.polygons ?? [];
    const here = outlines.filter(({ frame }) => frame === this.store.frame.value);
    if (!here.length) return;
    const whole = new Path2D();
    whole.rect(0, 0, width, height);
    for (const { points } of here) {
      const [first, ...rest] = points.map(([x, y]): Point => [x * width, y * height]);
      if (first) whole.moveTo(...first);
      for (const point of rest) whole.lineTo(...point);
      whole.closePath();
    }
    context.fillStyle = `rgb(${DIM.slice(0, 3).join(" ")} / ${DIM[3] / 255})`;
    context.fill(whole, "evenodd");
  }

  close(): void {
    this.view.close();
  }
}

function veil({ width, height }: RegionMap, dims: (i: number) => boolean): HTMLCanvasElement {
  const [canvas, context] = createCanvas({ width, height });
  const image = context.createImageData(width, height);
  for (let i = 0; i < width * height; i++) if (dims(i)) image.data.set(DIM, 4 * i);
  context.putImageData(image, 0, 0);
  return canvas;
}

function readMap(record: PreviewRecord): Promise<RegionMap> | undefined {
  const { header } = record;
  if (header.type !== "map" || !header.names) return undefined;
  const { names } = header;
  return pictureOf(record).then((picture) => {
    const { width, height } = picture;
    const [, context] = createCanvas(picture);
    context.drawImage(picture, 0, 0);
    const { data } = context.getImageData(0, 0, width, height);
    const regions = Uint8Array.from({ length: width * height }, (_, i) => data[4 * i] ?? 0);
    return { width, height, regions, names };
  });
}

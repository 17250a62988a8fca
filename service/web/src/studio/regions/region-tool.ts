/** Picking objects of the video as regions, and drawing regions with the lasso. */

import { signal } from "@preact/signals";
import { asProblem, isAbort } from "../../api/api";
import { colourOf } from "../clusters/label-edits";
import { pictureOf, preview } from "../document/api";
import { type Design, moveTube, REST, type Region, splitRegion, tubesOf, withRegion } from "../document/design";
import { freeName, type Point } from "../document/document";
import type { RegionsHeader } from "../document/records";
import { DRAG_MS } from "../document/undo";
import { distance, simplify } from "../drawing/geometry";
import { createCanvas } from "../drawing/raster";
import type { Store } from "../state/store";
import type { PointerSample, StageTool } from "../state/tool";
import type { RegionMaps } from "./region-map";

const SIMPLIFY = 0.002;
const LEAST_POINTS = 3;

/** Which tube is where in one frame. */
interface TubeMap {
  frame: number;
  width: number;
  height: number;
  tubes: Uint32Array;
  /** Tube of the frame -> object. */
  objects: ReadonlyMap<number, number>;
  /** Object of the frame -> its tubes in the whole video. */
  parts: ReadonlyMap<number, readonly number[]>;
}

export type RegionsState = "unknown" | "loading" | "ready" | "missing";
/** Whether the service can find regions; unknown before the first request. */
export const regionsState = signal<RegionsState>("unknown");

/** Whether the stage shows all objects of the frame in colours, and the borders of their parts. */
export const segmentationShown = signal(false);

/** How many objects there are in the shown frame; 0 until they are known. */
export const objectCount = signal(0);

export interface RegionTool extends StageTool {
  /** Find the regions of a frame, unless they are known. */
  load(frame: number): void;
  /** Draw all objects of the shown frame; the context is in pixels of the video. */
  drawAll(context: CanvasRenderingContext2D): void;
}

export function createRegionTool(store: Store, maps: RegionMaps, redraw: () => void): RegionTool {
  let map: TubeMap | null = null;
  let running = new AbortController();
  let hovered = -1;
  /** While Alt is held and the pointer is down: the region that is split, the part that becomes one of its own, the last point. */
  let splitting: { owner: string; name: string; last: Point } | null = null;
  let overlay: { key: string; canvas: HTMLCanvasElement } | null = null;
  let whole: { map: TubeMap; canvas: HTMLCanvasElement } | null = null;

  async function load(frame: number): Promise<void> {
    if (map?.frame === frame || regionsState.value === "missing") return;
    running.abort();
    running = new AbortController();
    const { signal } = running;
    if (!map) regionsState.value = "loading";
    try {
      await readMap(frame, signal);
      if (!signal.aborted) regionsState.value = map ? "ready" : "missing";
      if (!signal.aborted) objectCount.value = map?.parts.size ?? 0;
      redraw();
    } catch (error) {
      if (isAbort(error) || signal.aborted) return;
      const problem = asProblem(error);
      regionsState.value = problem.status === 404 ? "missing" : "unknown";
      if (problem.status === 404) store.tool.value = "lasso";
      if (problem.status !== 404) store.problem.value = problem.message;
    }
  }

  async function readMap(frame: number, signal: AbortSignal): Promise<void> {
    let picture: ImageBitmap | null = null;
    let found: RegionsHeader | null = null;
    const body = {
      document: store.document.value,
      shot: store.shot.value.id,
      layer: store.layerId.value,
      frame,
    };
    const pending: Promise<void>[] = [];
    await preview({
      project: store.projectId,
      what: "regions",
      channel: "regions",
      body,
      signal,
      onrecord(record) {
        const { header } = record;
        if (header.type === "regions") found = header;
        if (header.type === "progress") store.busy.value = header.note;
        if (header.type === "map") {
          pending.push(
            pictureOf(record).then((decoded) => {
              picture = decoded;
            }),
          );
        }
      },
    });
    await Promise.all(pending);
    store.busy.value = "";
    if (picture && found && !signal.aborted) map = tubeMap(frame, picture, found);
  }

  const tubeAt = ([x, y]: Point): number => {
    if (!map) return -1;
    const column = Math.floor((x / store.size.width) * map.width);
    const row = Math.floor((y / store.size.height) * map.height);
    if (column < 0 || row < 0 || column >= map.width || row >= map.height) return -1;
    return map.tubes[row * map.width + column] ?? -1;
  };

  function down({ at, shift, alt }: PointerSample): boolean {
    const tube = tubeAt(at);
    if (tube < 0 || !map) return false;
    const object = map.objects.get(tube) ?? -1;
    const { design } = store;
    const shown = maps.regionAt(at);
    const owner = shown && shown !== REST ? shown : ownerOf(design, tube, object);
    const selected = design.regions?.[store.region.value];
    if (shift && selected) extend(store.region.value, tube, object, alt);
    else if (owner && alt) split(owner, tube, at);
    else if (owner) store.region.value = owner === store.region.value ? "" : owner;
    else create(alt || object < 0 ? { tubes: [tube] } : { objects: [object] });
    redraw();
    return true;
  }

  const newName = (): string => freeName("region", (candidate) => candidate in (store.design.regions ?? {}));

  /** Make a part of a region a region of its own, with the same styles and directions at first. */
  function split(owner: string, tube: number, at: Point): void {
    const name = newName();
    const change = (design: Design) => splitRegion(design, owner, tube, name, partsOf);
    store.editDesign("Split a region", change, `split-${name}`, DRAG_MS);
    if (!(name in (store.design.regions ?? {}))) return;
    store.region.value = name;
    splitting = { owner, name, last: at };
  }

  /** All parts of the region under the stroke follow the first one. */
  function move(samples: readonly PointerSample[]): void {
    if (!splitting || !map) return;
    const { owner, name } = splitting;
    const step = store.size.width / map.width;
    for (const { at } of samples) {
      const { last } = splitting;
      const steps = Math.ceil(distance(last, at) / step);
      for (let i = 1; i <= steps; i++) {
        const tube = tubeAt([last[0] + ((at[0] - last[0]) * i) / steps, last[1] + ((at[1] - last[1]) * i) / steps]);
        const change = (design: Design) => moveTube(design, owner, tube, name);
        store.editDesign("Split a region", change, `split-${name}`, DRAG_MS);
      }
      splitting.last = at;
    }
    redraw();
  }

  const partsOf = (object: number): readonly number[] => map?.parts.get(object) ?? [];

  function create(region: Region): void {
    const name = newName();
    store.editDesign("New region", (design) => withRegion(design, name, region));
    store.region.value = name;
  }

  /** Add the picked part to the selected region; a region of objects that gets a single part becomes one of parts. */
  function extend(name: string, tube: number, object: number, part: boolean): void {
    store.editDesign("Extend a region", (design) => {
      const region = design.regions?.[name];
      return region ? withRegion(design, name, extended(region, tube, object, part)) : design;
    });
  }

  function extended(region: Region, tube: number, object: number, part: boolean): Region {
    if (region.objects && !part && object >= 0)
      return { ...region, objects: [...new Set([...region.objects, object])] };
    const { objects: _objects, ...rest } = region;
    const more = part || object < 0 ? [tube] : partsOf(object);
    return { ...rest, tubes: [...new Set([...tubesOf(region, partsOf), ...more])].sort((a, b) => a - b) };
  }

  /** What the pointer is over is marked; until the service has the film's regions, all but the selected one is dimmed. */
  function draw(context: CanvasRenderingContext2D): void {
    if (!map) return;
    const region = maps.view.present ? undefined : store.design.regions?.[store.region.value];
    const chosen = store.design.regions?.[store.region.value];
    const key = JSON.stringify([map.frame, hovered, region, chosen]);
    if (overlay?.key !== key) overlay = { key, canvas: dimmed(map, region, chosen, hovered) };
    drawMap(context, overlay.canvas);
  }

  function drawMap(context: CanvasRenderingContext2D, canvas: HTMLCanvasElement): void {
    context.imageSmoothingEnabled = false;
    context.drawImage(canvas, 0, 0, store.size.width, store.size.height);
    context.imageSmoothingEnabled = true;
  }

  function drawAll(context: CanvasRenderingContext2D): void {
    if (!segmentationShown.value || !store.section("regions") || map?.frame !== store.frame.value) return;
    if (whole?.map !== map) whole = { map, canvas: coloured(map) };
    drawMap(context, whole.canvas);
  }

  return {
    cursor: "pointer",
    load: (frame) => void load(frame),
    drawAll,
    down,
    move,
    up() {
      splitting = null;
    },
    hover(sample) {
      const tube = sample ? tubeAt(sample.at) : -1;
      const next = tube < 0 ? -1 : sample?.alt ? tube : (map?.objects.get(tube) ?? -1) + 1_000_000;
      if (next !== hovered) {
        hovered = next;
        redraw();
      }
    },
    draw,
  };
}

function tubeMap(frame: number, picture: ImageBitmap, found: RegionsHeader): TubeMap {
  const { width, height } = picture;
  const [, context] = createCanvas({ width, height });
  context.drawImage(picture, 0, 0);
  const { data } = context.getImageData(0, 0, width, height);
  const tubes = Uint32Array.from(
    { length: width * height },
    (_, i) => 65536 * (data[4 * i] ?? 0) + 256 * (data[4 * i + 1] ?? 0) + (data[4 * i + 2] ?? 0),
  );
  const objects = new Map(Object.entries(found.tubes).map(([tube, { object }]) => [Number(tube), object]));
  const parts = new Map(Object.entries(found.objects).map(([object, row]) => [Number(object), row.tubes]));
  return { frame, width, height, tubes, objects, parts };
}

const has = (region: Region, tube: number, object: number): boolean =>
  (region.objects?.includes(object) ?? false) || (region.tubes?.includes(tube) ?? false);

const ownerOf = (design: Design, tube: number, object: number): string | undefined =>
  Object.entries(design.regions ?? {}).findLast(([, region]) => has(region, tube, object))?.[0];

const HUE_ALPHA = 150;
const DARK = [20, 16, 12, 255];
const LIGHT = [255, 255, 255, 255];

/** Every object in a colour, white lines between its parts, dark ones between objects. */
function coloured(map: TubeMap): HTMLCanvasElement {
  const [canvas, context] = createCanvas(map);
  const image = context.createImageData(map.width, map.height);
  const objectAt = (i: number) => map.objects.get(map.tubes[i] ?? 0) ?? 0;
  const numbers = [0, ...new Set(map.objects.values())];
  const colours = new Map(numbers.map((object) => [object, [...colourOf(object + 1), HUE_ALPHA]]));
  map.tubes.forEach((tube, i) => {
    const left = i % map.width ? i - 1 : i;
    const above = i >= map.width ? i - map.width : i;
    const object = objectAt(i);
    const part = map.tubes[left] === tube && map.tubes[above] === tube;
    if (!part && (objectAt(left) !== object || objectAt(above) !== object)) image.data.set(DARK, 4 * i);
    else if (!part) image.data.set(LIGHT, 4 * i);
    else image.data.set(colours.get(object) ?? LIGHT, 4 * i);
  });
  context.putImageData(image, 0, 0);
  return canvas;
}

/** `region`: everything else is dimmed; `selected` is not marked under the pointer. */
function dimmed(
  map: TubeMap,
  region: Region | undefined,
  selected: Region | undefined,
  hovered: number,
): HTMLCanvasElement {
  const [canvas, context] = createCanvas(map);
  const image = context.createImageData(map.width, map.height);
  map.tubes.forEach((tube, i) => {
    const object = map.objects.get(tube) ?? -1;
    const chosen = selected ? has(selected, tube, object) : false;
    const pointed = hovered === tube || hovered === object + 1_000_000;
    const at = 4 * i;
    if (pointed && !chosen) image.data.set([255, 214, 90, 90], at);
    else if (!chosen && region && !region.polygons) image.data.set([12, 9, 7, 130], at);
  });
  context.putImageData(image, 0, 0);
  return canvas;
}

/** A closed line round a region of one's own, in the shown frame; with Shift, a further part of the selected one. */
export function createLassoTool(store: Store, redraw: () => void): StageTool {
  let points: Point[] = [];
  let further = false;

  function up(): void {
    const { width, height } = store.size;
    const shares = points.map(([x, y]): Point => [round(x / width), round(y / height)]);
    const outline = simplify(shares, SIMPLIFY);
    points = [];
    if (outline.length >= LEAST_POINTS) add(outline);
    redraw();
  }

  /** A new outline of the selected region if that was drawn, else of a new region. */
  function add(outline: Point[]): void {
    const frame = store.frame.value;
    const selected = store.design.regions?.[store.region.value];
    const known = store.design.regions ?? {};
    const name =
      selected && (further || selected.polygons)
        ? store.region.value
        : freeName("region", (candidate) => candidate in known);
    store.editDesign("Draw a region", (design) => {
      const others = design.regions?.[name]?.polygons?.filter((polygon) => further || polygon.frame !== frame) ?? [];
      const polygons = [...others, { frame, points: outline }].sort((a, b) => a.frame - b.frame);
      return withRegion(design, name, { ...design.regions?.[name], polygons });
    });
    store.region.value = name;
  }

  return {
    cursor: "crosshair",
    down({ at, shift }) {
      points = [at];
      further = shift;
      return true;
    },
    move(samples) {
      points.push(...samples.map((sample) => sample.at));
      redraw();
    },
    up,
    cancel() {
      points = [];
      redraw();
    },
    draw(context, px) {
      if (points.length > 1) drawOutline(context, points, px);
    },
  };
}

const round = (value: number): number => Math.round(value * 1e4) / 1e4;

/** Outlines of the selected region in the shown frame. */
export function drawOutlines(context: CanvasRenderingContext2D, store: Store, px: number): void {
  const { width, height } = store.size;
  const region = store.design.regions?.[store.region.value];
  for (const polygon of region?.polygons ?? []) {
    if (polygon.frame !== store.frame.value) continue;
    drawOutline(
      context,
      polygon.points.map(([x, y]): Point => [x * width, y * height]),
      px,
    );
  }
}

function drawOutline(context: CanvasRenderingContext2D, points: readonly Point[], px: number): void {
  context.beginPath();
  for (const point of points) context.lineTo(...point);
  context.closePath();
  for (const [color, line] of [
    ["#1b1510", 4],
    ["#ffd65a", 2],
  ] as const) {
    context.strokeStyle = color;
    context.lineWidth = line * px;
    context.stroke();
  }
}

/** Elements that direct the strokes of a region: placed, moved, turned and sized on the stage, with the field they make. */

import { effect, type Signal, signal } from "@preact/signals";
import {
  type Design,
  type DirectionElement,
  type DirectionKey,
  type Pattern,
  putOnTrack,
  REST,
  trackOf,
} from "../document/design";
import { keyAt, type Point } from "../document/document";
import { DRAG_MS, GROUP_MS } from "../document/undo";
import { angleOf, directionAt, distance, distanceOf, isSymmetric } from "../drawing/geometry";
import type { Store } from "../state/store";
import type { PointerSample, StageTool } from "../state/tool";
import type { FilmView } from "./film-view";
import { drawField, type Field } from "./true-field";

const HANDLE_PX = 14;
const FIELD_PX = 26;
const DEFAULT_REACH = 0.35;
/** Share of the picture's own directions in a new key. */
export const EDGE_WEIGHT = 0.2;
/** Distance of the handle of an element that reaches everywhere, heights of the picture. */
const HANDLE_REACH = 0.35;

export const pattern: Signal<Pattern> = signal("regular");
/** Index of the selected element; -1: none. */
export const selectedElement = signal(-1);

/** What the design sets at the shown frame, by region, once the service has told it. */
const moved: Signal<Field["moved"]> = signal({});
export const followField = (field: FilmView<Field>): (() => void) =>
  effect(() => {
    moved.value = field.present?.moved ?? {};
  });

/** The directions of the selected region that hold at the shown frame; at other frames than its own, a key has moved. */
export function presentKey(store: Store): DirectionKey | undefined {
  const region = store.region.value || REST;
  const key = keyAt(trackOf(store.design.directions, region), store.frame.value);
  return key && key.frame !== store.frame.value ? { ...key, ...moved.value[region] } : key;
}

/** Change the directions of the selected region at the shown frame; a key there is made if there was none. */
export function editDirections(
  store: Store,
  label: string,
  change: (key: DirectionKey) => Partial<DirectionKey>,
  group = "",
  within = GROUP_MS,
): void {
  const region = store.region.value || REST;
  const frame = store.frame.value;
  const known: DirectionKey = { edge_weight: EDGE_WEIGHT, elements: [], ...presentKey(store), region, frame };
  const key = { ...known, ...change(known) };
  const put = (design: Design) => ({ ...design, directions: putOnTrack(design.directions, key) });
  store.editDesign(label, put, group, within);
}

/** Change the elements at the shown frame. */
export function editElements(
  store: Store,
  label: string,
  change: (elements: readonly DirectionElement[]) => DirectionElement[],
  group = "",
  within = GROUP_MS,
): void {
  editDirections(store, label, ({ elements }) => ({ elements: change(elements) }), group, within);
}

/** "size": a new element, of which the pointer sets the reach, and the angle where that turns the whole pattern. */
type Drag = "move" | "turn" | "size";

export function createDirectionTool(store: Store, field: FilmView<Field>, redraw: () => void): StageTool {
  let drag: Drag | null = null;
  let drags = 0;

  const toShares = ([x, y]: Point): Point => [round(x / store.size.width), round(y / store.size.height)];
  const toPixels = ([x, y]: Point): Point => [x * store.size.width, y * store.size.height];

  /** Where the handle for angle and reach is, px. */
  function handleOf({ at, angle = 0, reach }: DirectionElement): Point {
    const [x, y] = toPixels(at);
    const length = (distanceOf(reach) || HANDLE_REACH) * store.size.height;
    const turn = (angle * Math.PI) / 180;
    return [x + length * Math.cos(turn), y + length * Math.sin(turn)];
  }

  function down({ at }: PointerSample): boolean {
    const near = HANDLE_PX / store.view.value.scale;
    const elements = presentKey(store)?.elements ?? [];
    const selected = elements[selectedElement.value];
    drags += 1;
    if (selected && distance(handleOf(selected), at) < near) drag = "turn";
    else {
      const hit = elements.findIndex((element) => distance(toPixels(element.at), at) < near);
      if (hit < 0) place(at);
      else selectedElement.value = hit;
      drag = hit < 0 ? "size" : "move";
    }
    redraw();
    return true;
  }

  function place(at: Point): void {
    const element = { pattern: pattern.value, at: toShares(at), angle: 0, reach: DEFAULT_REACH, strength: 1 };
    editElements(
      store,
      "Place a direction",
      (elements) => {
        selectedElement.value = elements.length;
        return [...elements, element];
      },
      `direction-${drags}`,
      DRAG_MS,
    );
  }

  function move(samples: readonly PointerSample[]): void {
    const at = samples.at(-1)?.at;
    const index = selectedElement.value;
    if (!at || !drag) return;
    const label = drag === "move" ? "Move a direction" : "Turn a direction";
    const changed = (element: DirectionElement) =>
      drag === "move" ? { ...element, at: toShares(at) } : turned(element, at);
    editElements(
      store,
      label,
      (elements) => elements.map((element, i) => (i === index ? changed(element) : element)),
      `direction-${drags}`,
      DRAG_MS,
    );
    redraw();
  }

  function turned(element: DirectionElement, at: Point): DirectionElement {
    const centre = toPixels(element.at);
    const reach = distance(centre, at) / store.size.height;
    if (reach < 0.01) return element;
    const angle = drag === "size" && isSymmetric(element.pattern) ? 0 : Math.round(angleOf(centre, at));
    const everywhere = drag === "turn" && !distanceOf(element.reach);
    return { ...element, angle, ...(!everywhere && { reach: Math.round(reach * 100) / 100 }) };
  }

  function draw(context: CanvasRenderingContext2D, px: number): void {
    const elements = presentKey(store)?.elements ?? [];
    const found = field.present;
    if (found && !drag) drawField(context, found, store.size, px);
    else if (elements.length) drawElements(context, elements, px);
    for (const [i, element] of elements.entries()) drawElement(context, element, i === selectedElement.value, px);
  }

  /** The field of the elements alone, until the service has the film's. */
  function drawElements(context: CanvasRenderingContext2D, elements: readonly DirectionElement[], px: number): void {
    const { width, height } = store.size;
    const spacing = FIELD_PX * px;
    context.lineCap = "round";
    for (let y = spacing / 2; y < height; y += spacing) {
      for (let x = spacing / 2; x < width; x += spacing) {
        const { angle, weight } = directionAt(elements, [x / width, y / height], width / height);
        const [dx, dy] = [Math.cos(angle) * spacing * 0.38, Math.sin(angle) * spacing * 0.38];
        context.globalAlpha = Math.min(0.9, 0.15 + weight);
        line(context, [x - dx, y - dy], [x + dx, y + dy], px);
      }
    }
    context.globalAlpha = 1;
  }

  function drawElement(
    context: CanvasRenderingContext2D,
    element: DirectionElement,
    selected: boolean,
    px: number,
  ): void {
    const centre = toPixels(element.at);
    if (selected) {
      line(context, centre, handleOf(element), px);
      dot(context, handleOf(element), 6 * px, "#ffd65a", px);
    }
    dot(context, centre, 8 * px, selected ? "#e0573a" : "#fff", px);
  }

  return {
    cursor: "crosshair",
    down,
    move,
    up() {
      drag = null;
    },
    draw,
  };
}

const round = (value: number): number => Math.round(value * 1e4) / 1e4;

function line(context: CanvasRenderingContext2D, from: Point, to: Point, px: number): void {
  for (const [color, width] of [
    ["#1b1510", 3.4],
    ["#fff", 1.6],
  ] as const) {
    context.strokeStyle = color;
    context.lineWidth = width * px;
    context.beginPath();
    context.moveTo(...from);
    context.lineTo(...to);
    context.stroke();
  }
}

function dot(context: CanvasRenderingContext2D, [x, y]: Point, radius: number, color: string, px: number): void {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.fillStyle = color;
  context.fill();
  context.strokeStyle = "#1b1510";
  context.lineWidth = 1.5 * px;
  context.stroke();
}

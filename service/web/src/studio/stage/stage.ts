/** The stage: one canvas with the frame, its painting, the key under the pen and the tools' marks; zoom, pan and wipe. */

import { effect } from "@preact/signals";
import { fitView, matrixOf, mirrorAbout, panBy, toPicture, turnAbout, type View, zoomAbout } from "../drawing/geometry";
import type { Rect } from "../drawing/rect";
import type { PaintView } from "../drawing/settings";
import type { KeyPicture } from "../drawing/strokes";
import type { Films } from "../films/films";
import type { PaintedKeys } from "../keys/keys";
import type { PaintTool } from "../keys/paint-tool";
import type { FrameSource } from "../previews/frames";
import type { ScrubFrames } from "../previews/scrub";
import { drawOutlines } from "../regions/region-tool";
import { PAINT_TOOLS, type StageView, type Store, type Tool } from "../state/store";
import type { PointerSample, StageTool } from "../state/tool";
import { createBrushRing } from "./brush-ring";
import type { OnionSkin } from "./onion-skin";
import { drawPart, onCanvas, tiltOf } from "./stage-drawing";

const WHEEL_ZOOM = 1.0015;
const GRAB_PX = 22;
/** A finger that moves less than this taps. */
const TAP_PX = 6;
/** Opacity of the painting, or of the key, over the frame in the view "overlay". */
const OVERLAY_ALPHA = 0.5;
/** Of what was on the stage before, until the shot has a picture. */
const WAITING_ALPHA = 0.45;

export interface StageParts {
  store: Store;
  frames: FrameSource;
  scrub: ScrubFrames;
  films: Films;
  keys: PaintedKeys;
  paint: PaintTool;
  tools: Partial<Record<Tool, StageTool>>;
  onion: OnionSkin;
  /** What the stage showed before this shot. */
  before?: HTMLCanvasElement | undefined;
  /** Drawn over the picture and below the tools' marks; the context is in pixels of the video. */
  overlays: readonly ((context: CanvasRenderingContext2D) => void)[];
}

export interface Stage {
  redraw(): void;
  fit(): void;
  zoom(factor: number): void;
  /** Degrees clockwise about the middle. */
  turn(degrees: number): void;
  mirror(): void;
  close(): void;
}

export function mountStage(
  canvas: HTMLCanvasElement,
  { store, frames, scrub, films, keys, paint, tools, onion, overlays, before }: StageParts,
): Stage {
  const context = canvas.getContext("2d");
  const pointers = new Map<number, [number, number]>();
  let pending = 0;
  /** "held": a finger that may become the first of two; the tool gets it once it moves or is lifted. */
  let mode: "tool" | "pan" | "wipe" | "held" | "size" | null = null;
  let held: PointerEvent | null = null;
  /** The pen that is down; while it is, fingers and the palm are ignored. */
  let pen: number | null = null;
  /** Once somebody draws with a pen, fingers move the view only. */
  let penUsed = false;
  let fitted = true;

  const ring = createBrushRing(canvas, store);

  const painting = () => PAINT_TOOLS.includes(store.tool.value);
  const tool = (): StageTool | undefined => tools[store.tool.value] ?? (painting() ? paint : undefined);

  function redraw(): void {
    if (!pending) pending = requestAnimationFrame(drawAll);
  }

  function resize(): void {
    const { clientWidth, clientHeight } = canvas;
    const ratio = devicePixelRatio || 1;
    Object.assign(canvas, { width: Math.round(clientWidth * ratio), height: Math.round(clientHeight * ratio) });
    if (fitted) fitPicture();
    drawAll(); // at once: a canvas of another size is empty
  }

  function fitPicture(turned: Partial<View> = store.view.value): void {
    fitted = true;
    store.view.value = fitView(store.size, { width: canvas.clientWidth, height: canvas.clientHeight }, 12, turned);
  }

  const middle = (): [number, number] => [canvas.clientWidth / 2, canvas.clientHeight / 2];

  /** Another turn or mirror of the view, which stays fitted if it was. */
  function setTurn(view: View): void {
    if (fitted) fitPicture(view);
    else setView(view);
  }

  function setView(view: View): void {
    fitted = false;
    store.view.value = view;
  }

  // -- drawing

  function drawAll(): void {
    cancelAnimationFrame(pending);
    pending = 0;
    draw();
  }

  /** Draw the stroke under the pen now, not with the next frame of the page; only where it has changed the picture. */
  function drawStroke(): void {
    const shown = paint.shown();
    if (pending || !shown?.live) {
      redraw();
      return;
    }
    keys.raster.whole(store.pictureKey(store.frame.value), shown.picture, shown.live);
    if (keys.raster.changed) draw(keys.raster.changed);
  }

  /** `part` of the picture; without it, everything. */
  function draw(part?: Rect): void {
    if (!context || !canvas.width) return;
    const ratio = devicePixelRatio || 1;
    const { scale, x, y } = store.view.value;
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.save();
    const place = part
      ? onCanvas(part, store.view.value, ratio)
      : { x: 0, y: 0, width: canvas.width, height: canvas.height };
    if (part) {
      context.beginPath();
      context.rect(place.x, place.y, place.width, place.height);
      context.clip();
    }
    context.clearRect(place.x, place.y, place.width, place.height);
    const [a, b, c, d] = matrixOf(store.view.value);
    context.setTransform(ratio * a, ratio * b, ratio * c, ratio * d, ratio * x, ratio * y);
    context.imageSmoothingEnabled = scale < 3;
    const key = !store.compared.value && painting() ? paint.shown() : null;
    const newest = newestFrame();
    if (!key || !hides(key.picture)) drawSource();
    if (newest) drawWhole(newest);
    else if (store.compared.value) drawCompared(store.compared.value);
    else if (painting() && key) drawKey(key);
    else if (store.stageView.value === "film") drawFilm();
    else drawPainted();
    const px = 1 / scale;
    if (!newest) {
      for (const overlay of overlays) overlay(context);
      drawOutlines(context, store, px);
    }
    if (key) onion.draw(context);
    tool()?.draw?.(context, px);
    context.restore();
    if (!part) tellState();
  }

  function tellState(): void {
    canvas.dataset.frame = String(scrubbed() ? store.frame.value : frames.shown);
    canvas.dataset.waiting = String(!scrubbed() && !frames.picture);
    canvas.dataset.exact = String(frames.shown === store.frame.value);
    canvas.dataset.compared = store.compared.value ? "variants" : "";
    canvas.dataset.film = String(store.stageView.value === "film" && !painting() ? films.shown : "");
    canvas.dataset.painting = films.painting()?.from ?? "none";
    canvas.dataset.result = store.results.value.get(store.frame.value)?.final ? "final" : "";
  }

  function drawWhole(picture: CanvasImageSource): void {
    const { width, height } = store.size;
    context?.drawImage(picture, 0, 0, width, height);
  }

  function drawSource(): void {
    const picture = scrubbed() ?? frames.picture;
    if (picture) drawWhole(picture);
    else drawBefore();
  }

  /** The stage as it was while another shot was shown, dimmed: nothing of this one is there yet. */
  function drawBefore(): void {
    if (!before || !context) return;
    context.save();
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.globalAlpha = WAITING_ALPHA;
    context.drawImage(before, 0, 0, canvas.width, canvas.height);
    context.restore();
  }

  /** The small picture of the wanted frame, while the exact one is not there. */
  const scrubbed = (): ImageBitmap | undefined =>
    frames.shown === store.frame.value ? undefined : scrub.at(store.frame.value);

  const hides = (picture: KeyPicture) => store.drawing.view.value === "key" && keys.raster.covers(picture);

  function drawKey(shown: ReturnType<PaintTool["shown"]>): void {
    const view = store.drawing.view.value;
    if (!shown || !context || view === "source") return;
    const key = store.pictureKey(store.frame.value);
    drawOver(keys.raster.whole(key, shown.picture, shown.live), view);
  }

  const drawOver = (picture: CanvasImageSource, view: StageView | PaintView) =>
    context &&
    drawPart(context, picture, store, { split: view === "compare", alpha: view === "overlay" ? OVERLAY_ALPHA : 1 });

  function drawPainted(): void {
    const shown = films.painting();
    const view = store.stageView.value;
    if (!shown || view === "source" || !context) return;
    drawOver(shown.picture, view);
  }

  function drawFilm(): void {
    const picture = films.picture();
    if (picture) drawWhole(picture);
  }

  /** Shows a film that is being painted. Its newest frame is seldom the selected one, so that no marks are drawn on it. */
  function newestFrame(): CanvasImageSource | null {
    const shown = store.stageView.value === "film" && store.tool.value === "pan" && !store.compared.value;
    return shown ? films.newest.value : null;
  }

  function drawCompared({ left, right }: { left: ImageBitmap; right: ImageBitmap }): void {
    drawWhole(left);
    drawOver(right, "compare");
  }

  // -- pointer

  const local = (event: MouseEvent): [number, number] => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };

  function sample(event: PointerEvent): PointerSample {
    const pen = event.pointerType === "pen";
    return {
      at: toPicture(store.view.value, local(event)),
      pressure: pen ? event.pressure : 1,
      ...(pen && tiltOf(event, store.view.value)),
      shift: event.shiftKey,
      alt: event.altKey,
    };
  }

  function onDivider(at: [number, number]): boolean {
    const [x, y] = toPicture(store.view.value, at);
    const away = store.view.value.scale * Math.abs(store.split.value * store.size.width - x);
    if (store.compared.value) return away < GRAB_PX;
    // with a brush, the divider is moved by its handle only
    if (painting())
      return (
        store.drawing.view.value === "compare" &&
        Math.hypot(away, store.view.value.scale * (y - store.size.height / 2)) < GRAB_PX
      );
    return store.stageView.value === "compare" && store.results.value.has(store.frame.value) && away < GRAB_PX;
  }

  function pointerDown(event: PointerEvent): void {
    event.preventDefault();
    if (event.button > 1 || (pen !== null && event.pointerId !== pen)) return;
    if (event.pointerType === "pen") putDownPen(event);
    canvas.setPointerCapture(event.pointerId);
    canvas.focus({ preventScroll: true });
    pointers.set(event.pointerId, local(event));
    const finger = event.pointerType === "touch";
    if (pointers.size > 1) {
      if (mode === "tool") cancelTool();
      mode = "pan";
    } else if (event.button === 1 || (finger && penUsed)) mode = "pan";
    else if (onDivider(local(event)) && (store.compared.value || painting() || store.tool.value === "pan"))
      mode = "wipe";
    else if ((event.ctrlKey || event.metaKey) && ring.grab(local(event))) mode = "size";
    else if (finger) [mode, held] = ["held", event];
    else press(event);
  }

  function putDownPen(event: PointerEvent): void {
    if (mode === "tool") cancelTool();
    pointers.clear();
    pen = event.pointerId;
    penUsed = true;
  }

  function press(event: PointerEvent): void {
    mode = tool()?.down(sample(event)) ? "tool" : "pan";
  }

  /** End the tool's action without an effect, where the tool can. */
  function cancelTool(): void {
    const used = tool();
    if (used?.cancel) used.cancel();
    else used?.up();
  }

  function pointerMove(event: PointerEvent): void {
    const before = pointers.get(event.pointerId);
    ring.move(local(event));
    if (!before) {
      tool()?.hover?.(sample(event));
      canvas.style.cursor =
        onDivider(local(event)) && store.tool.value === "pan" ? "ew-resize" : (tool()?.cursor ?? "grab");
      return;
    }
    const now = local(event);
    if (mode === "held" && held) {
      const [x, y] = local(held);
      if (Math.hypot(now[0] - x, now[1] - y) < TAP_PX) return;
      press(held);
    }
    if (mode === "tool") {
      tool()?.move(coalesced(event));
      if (painting()) drawStroke();
    } else if (mode === "size") ring.drag(now);
    else if (mode === "wipe")
      store.split.value = Math.min(1, Math.max(0, toPicture(store.view.value, now)[0] / store.size.width));
    else if (mode === "pan") pan(event.pointerId, before, now);
    pointers.set(event.pointerId, now);
  }

  /** All positions since the last event: a pen reports more than one per frame. */
  function coalesced(event: PointerEvent): PointerSample[] {
    const all = event.getCoalescedEvents?.() ?? [];
    return (all.length ? all : [event]).map(sample);
  }

  function pan(id: number, before: [number, number], now: [number, number]): void {
    const other = [...pointers].find(([pointer]) => pointer !== id)?.[1];
    let view = panBy(store.view.value, (now[0] - before[0]) / pointers.size, (now[1] - before[1]) / pointers.size);
    if (other) {
      const factor =
        Math.hypot(now[0] - other[0], now[1] - other[1]) /
        Math.max(1, Math.hypot(before[0] - other[0], before[1] - other[1]));
      view = zoomAbout(view, [(now[0] + other[0]) / 2, (now[1] + other[1]) / 2], factor);
    }
    setView(view);
  }

  function pointerUp(event: PointerEvent): void {
    if (event.pointerId === pen) pen = null;
    if (!pointers.delete(event.pointerId)) return;
    if (mode === "held" && held) press(held);
    if (mode === "tool") tool()?.up();
    if (!pointers.size) mode = null;
  }

  /** The browser took the pointer: a finger leaves nothing, a pen's stroke is kept. */
  function pointerCancel(event: PointerEvent): void {
    if (event.pointerType === "touch" && pointers.has(event.pointerId)) {
      if (mode === "tool") cancelTool();
      mode = "pan";
    }
    pointerUp(event);
  }

  function wheel(event: WheelEvent): void {
    event.preventDefault();
    setView(zoomAbout(store.view.value, local(event), WHEEL_ZOOM ** -event.deltaY));
  }

  canvas.addEventListener("pointerdown", pointerDown);
  canvas.addEventListener("pointermove", pointerMove);
  canvas.addEventListener("pointerup", pointerUp);
  canvas.addEventListener("pointercancel", pointerCancel);
  canvas.addEventListener("pointerleave", () => {
    ring.move(null);
    tool()?.hover?.(null);
  });
  canvas.addEventListener("wheel", wheel, { passive: false });
  const observer = new ResizeObserver(resize);
  observer.observe(canvas);
  const stop = effect(() => {
    const { view, stageView, split, results, compared, history, frame, tool: chosen, region, layerId, playing } = store;
    const { view: paintView, onion: skin } = store.drawing;
    const seen = [view, stageView, split, results, compared, history, frame, chosen, region, layerId, playing];
    for (const each of [paintView, skin]) each.value;
    for (const each of seen) each.value;
    redraw();
  });

  return {
    redraw,
    fit: () => fitPicture({}),
    zoom: (factor) => setView(zoomAbout(store.view.value, middle(), factor)),
    turn: (degrees) => setTurn(turnAbout(store.view.value, middle(), degrees)),
    mirror: () => setTurn(mirrorAbout(store.view.value, middle())),
    close() {
      ring.close();
      stop();
      observer.disconnect();
      cancelAnimationFrame(pending);
    },
  };
}

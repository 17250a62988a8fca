/** Draws strokes on the canvas of a layer: whole ones, and the one under the pen as it grows. */

import type { Tip } from "../document/tip";
import { type Context, createCanvas } from "./canvas";
import { drawLocked, makeOpaque, replaceColours } from "./compose";
import { valueAt } from "./curves";
import type { Size } from "./geometry";
import { clipped, type Rect, unionOf } from "./rect";
import { Smudger } from "./smudge";
import { type PaintBuffers, StrokeMask } from "./stroke-mask";
import {
  type BrushStroke,
  type DrawnStroke,
  type FillStroke,
  rowsOf,
  type Sample,
  type SmudgeStroke,
  type Stroke,
  widthAt,
} from "./strokes";
import { drawTransform } from "./transform";

/** Draw the part of a plain line between samples `from` and `until`. */
function drawSegments(context: Context, stroke: BrushStroke, from: number, until: number): void {
  context.lineCap = "round";
  context.lineJoin = "round";
  context.strokeStyle = stroke.kind === "eraser" ? "#000" : stroke.color;
  for (let i = Math.max(1, from); i < until; i++) {
    const [a, b] = [stroke.samples[i - 1], stroke.samples[i]];
    if (a && b) drawSegment(context, stroke.size, a, b);
  }
  const only = stroke.samples[0];
  if (from === 0 && only) drawSegment(context, stroke.size, only, [only[0] + 0.01, only[1], only[2]]);
}

function drawSegment(context: Context, size: number, a: Sample, b: Sample): void {
  context.lineWidth = (widthAt(size, a[2]) + widthAt(size, b[2])) / 2;
  context.beginPath();
  context.moveTo(a[0], a[1]);
  context.lineTo(b[0], b[1]);
  context.stroke();
}

/** Draw one whole stroke; overlapping parts of a translucent stroke do not add up. */
export function drawStroke(context: Context, stroke: Stroke, buffers: PaintBuffers): void {
  context.save();
  if (stroke.kind === "transform") drawTransform(context, stroke, buffers.size);
  else if (stroke.locked) {
    const rect = boundsOf(stroke, buffers.size);
    if (rect) drawLocked(context, rect, (own) => drawStroke(own, { ...stroke, locked: false }, buffers));
  } else if (stroke.kind === "fill") drawFill(context, stroke, buffers.size);
  else if (stroke.kind === "smudge") {
    const smudger = new Smudger(context, stroke);
    for (const sample of stroke.samples) smudger.to(sample);
  } else if (stroke.tip) drawStamps(context, stroke, stroke.tip, buffers);
  else if (stroke.opacity >= 1) {
    context.globalCompositeOperation = stroke.kind === "eraser" ? "destination-out" : "source-over";
    drawSegments(context, stroke, 0, stroke.samples.length);
  } else {
    const [scratch, own] = createCanvas(buffers.size);
    drawSegments(own, stroke, 0, stroke.samples.length);
    context.globalAlpha = stroke.opacity;
    context.globalCompositeOperation = stroke.kind === "eraser" ? "destination-out" : "source-over";
    context.drawImage(scratch, 0, 0);
  }
  context.restore();
}

function drawFill(context: Context, { color, opacity, runs, erase }: FillStroke, { width }: Size): void {
  context.globalCompositeOperation = erase ? "destination-out" : "source-over";
  context.fillStyle = color;
  context.globalAlpha = opacity;
  for (const [x, y, length] of rowsOf(runs, width)) context.fillRect(x, y, length, 1);
}

function drawStamps(context: Context, stroke: BrushStroke, tip: Tip, buffers: PaintBuffers): void {
  const mask = new StrokeMask(stroke, tip, buffers);
  for (const sample of stroke.samples) mask.to(sample);
  mask.end();
  if (mask.used) lay(mask, mask.used, context, context);
  mask.free();
}

function lay(mask: StrokeMask, rect: Rect, from: Context, to: Context): void {
  const pixels = from.getImageData(rect.x, rect.y, rect.width, rect.height);
  mask.lay(pixels.data, rect);
  to.putImageData(pixels, rect.x, rect.y);
}

/** Pixels that a stroke can change; null: none of the picture. */
export function boundsOf(stroke: Stroke, size: Size): Rect | null {
  let rect: Rect | null = null;
  if (stroke.kind === "transform") return { x: 0, y: 0, ...size };
  if (stroke.kind === "fill") {
    for (const [x, y, width] of rowsOf(stroke.runs, size.width)) rect = unionOf(rect, { x, y, width, height: 1 });
    return rect;
  }
  const [, , , tilt = 0] = stroke.samples.reduce((a, b) => ((b[3] ?? 0) > (a[3] ?? 0) ? b : a), [0, 0, 0, 0]);
  const reach = stroke.tip ? reachOf(stroke.tip, stroke.size, tilt) : 0;
  const margin = Math.ceil(Math.max(stroke.size / 2, reach)) + 3;
  for (const [x, y] of stroke.samples) {
    const box = { x: Math.floor(x) - margin, y: Math.floor(y) - margin, width: 2 * margin + 1, height: 2 * margin + 1 };
    rect = unionOf(rect, box);
  }
  return rect && clipped(rect, size);
}

/** How far from the path of a stroke its stamps reach, px. `tilt`: the largest, degrees. */
function reachOf(tip: Tip, size: number, tilt: number): number {
  const widest = tilt ? Math.max(...tip.size.tilt) : valueAt(tip.size.tilt, 0);
  return size * Math.max(...tip.size.pressure) * widest * (Math.SQRT1_2 + tip.scatter);
}

/** The stroke under the pen on its layer. */
export interface LiveDrawing {
  readonly stroke: DrawnStroke;
  /** The layer with the stroke. */
  readonly canvas: HTMLCanvasElement;
  /** Draw the samples that are new; the pixels that have changed. */
  grow(): Rect | null;
  /** The stroke has ended; the pixels that have changed since the last call. */
  end(): Rect | null;
}

/** `layer` must not change while the stroke grows. */
export function startLive(stroke: DrawnStroke, layer: HTMLCanvasElement, buffers: PaintBuffers): LiveDrawing {
  if (stroke.locked) return liveLocked(stroke, layer, buffers);
  const [canvas, context] = createCanvas(buffers.size);
  context.drawImage(layer, 0, 0);
  if (stroke.kind === "smudge") return liveSmudge(stroke, canvas, context, buffers.size);
  return stroke.tip
    ? liveStamps(stroke, stroke.tip, layer, canvas, context, buffers)
    : livePlain(stroke, layer, canvas, context, buffers.size);
}

/** A growing stroke on a layer whose opacity stays as it is. */
function liveLocked(stroke: DrawnStroke, layer: HTMLCanvasElement, buffers: PaintBuffers): LiveDrawing {
  const [opaque, below] = createCanvas(buffers.size);
  below.drawImage(layer, 0, 0);
  makeOpaque(below);
  const drawing = startLive({ ...stroke, locked: false }, opaque, buffers);
  const [canvas, context] = createCanvas(buffers.size);
  context.drawImage(layer, 0, 0);
  const within = (rect: Rect | null) => {
    if (rect) replaceColours(context, rect, drawing.canvas, layer);
    return rect;
  };
  return { stroke, canvas, grow: () => within(drawing.grow()), end: () => within(drawing.end()) };
}

function liveSmudge(stroke: SmudgeStroke, canvas: HTMLCanvasElement, context: Context, size: Size): LiveDrawing {
  const smudger = new Smudger(context, stroke);
  let drawn = 0;
  const grow = () => {
    const fresh = stroke.samples.slice(drawn);
    const changed = boundsOf({ ...stroke, samples: stroke.samples.slice(Math.max(0, drawn - 1)) }, size);
    for (const sample of fresh) smudger.to(sample);
    drawn = stroke.samples.length;
    return fresh.length ? changed : null;
  };
  return { stroke, canvas, grow, end: grow };
}

function liveStamps(
  stroke: BrushStroke,
  tip: Tip,
  layer: HTMLCanvasElement,
  canvas: HTMLCanvasElement,
  context: Context,
  buffers: PaintBuffers,
): LiveDrawing {
  const mask = new StrokeMask(stroke, tip, buffers);
  const below = layer.getContext("2d") as Context;
  let drawn = 0;
  const grow = () => {
    for (; drawn < stroke.samples.length; drawn++) mask.to(stroke.samples[drawn] as Sample);
    const rect = mask.touched();
    if (rect) lay(mask, rect, below, context);
    return rect;
  };
  const end = () => {
    const grown = grow();
    mask.end();
    const rect = mask.touched();
    if (rect) lay(mask, rect, below, context);
    mask.free();
    return rect ? unionOf(grown, rect) : grown;
  };
  return { stroke, canvas, grow, end };
}

/** A plain line grows on a canvas of its own, which is laid over the layer. */
function livePlain(
  stroke: BrushStroke,
  layer: HTMLCanvasElement,
  canvas: HTMLCanvasElement,
  context: Context,
  size: Size,
): LiveDrawing {
  const [scratch, own] = createCanvas(size);
  let drawn = 0;
  const grow = () => {
    if (drawn === stroke.samples.length) return null;
    const rect = boundsOf({ ...stroke, samples: stroke.samples.slice(Math.max(0, drawn - 1)) }, size);
    drawSegments(own, stroke, drawn, stroke.samples.length);
    drawn = stroke.samples.length;
    if (!rect) return null;
    const { x, y, width, height } = rect;
    context.clearRect(x, y, width, height);
    context.globalCompositeOperation = "source-over";
    context.drawImage(layer, x, y, width, height, x, y, width, height);
    context.globalCompositeOperation = stroke.kind === "eraser" ? "destination-out" : "source-over";
    context.globalAlpha = stroke.opacity;
    context.drawImage(scratch, x, y, width, height, x, y, width, height);
    context.globalAlpha = 1;
    return rect;
  };
  return { stroke, canvas, grow, end: grow };
}

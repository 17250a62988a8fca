/** The state of the studio while it shows a shot: its frames, what is selected, what the stage shows. */

import { computed, type ReadonlySignal, type Signal, signal } from "@preact/signals";
import type { Asset, Job, Method, Overlay, Section } from "../../api/schemas";
import type { Design } from "../document/design";
import {
  changeLayer,
  type Layer,
  type LayerPlace,
  layerOf,
  type ProjectDocument,
  type Shot,
  shotOf,
  withPart,
} from "../document/document";
import { framesOf } from "../document/shots";
import type { Tip } from "../document/tip";
import { GROUP_MS, record } from "../document/undo";
import type { View } from "../drawing/geometry";
import type { Session, State } from "./session";
import { clampFrame, type Span, spanWith } from "./timeline";

export type Tool =
  | "pan"
  | "brush"
  | "eraser"
  | "smudge"
  | "fill"
  | "picker"
  | "rectangle"
  | "outline"
  | "transform"
  | "region"
  | "lasso"
  | "correct"
  | "direction"
  | "label"
  | "object"
  | "matte"
  | "matteBrush"
  | "matteEraser"
  | "loupe";
/** Whether the brush paints on the part of a section. */
export const isPainted = ({ editor }: Section): boolean => editor === "keys" || editor === "marks";
/** Tools that select and move what is painted. */
export const SELECT_TOOLS: readonly Tool[] = ["rectangle", "outline", "transform"];
/** Tools with which the stage shows the key. */
export const PAINT_TOOLS: readonly Tool[] = ["brush", "eraser", "smudge", "fill", "picker", "object", ...SELECT_TOOLS];

/** Tools whose strokes have a size. */
export const DRAWN_TOOLS: readonly Tool[] = ["brush", "eraser", "smudge", "correct", "matteBrush", "matteEraser"];
/** Tools that make the matte of a layer. */
export const MATTE_TOOLS: readonly Tool[] = ["matte", "matteBrush", "matteEraser"];
/** Tools whose strokes are plain lines. */
const PLAIN_TOOLS: readonly Tool[] = ["correct", ...MATTE_TOOLS];
/** Largest width of a brush, px. */
export const MAX_BRUSH_PX = 400;

const pictureKey = ({ shot, layer }: LayerPlace, frame: number, part: string): string =>
  `${shot}/${layer}:${frame}:${part}`;

/** What a key of `State.pictures` stands for; `part` is empty in what earlier versions have kept in the browser. */
export function pictureAt(key: string): LayerPlace & { frame: number; part: string } {
  const [place = "", frame = "0", part = ""] = key.split(":");
  const [layer = "", shot = ""] = place.split("/").reverse();
  return { shot, layer, frame: Number(frame), part };
}

/** A painted frame as a preview or a finished job gave it. */
export interface Result {
  frame: number;
  picture: ImageBitmap;
  /** Size of the preview relative to the video. */
  scale: number;
  /** Whether it is the film's picture; else it is a draft. */
  final: boolean;
  /** The document that it shows; a newer one makes it old. */
  document: ProjectDocument;
  /** The layer that it shows; undefined: all visible ones. */
  layer: string | undefined;
}

/** "overlay": the painting, half transparent, over the frame; "flicker": where it flickers; "film": the newest film. */
export type StageView = "source" | "compare" | "overlay" | "painted" | "flicker" | "film";

/** Views of paintings, which show the video where there is none. */
export const PAINTED_VIEWS: readonly StageView[] = ["compare", "overlay", "painted"];

export class Store {
  readonly projectId: string;
  readonly methods: readonly Method[];
  readonly history: Session["history"];
  readonly document: ReadonlySignal<ProjectDocument>;
  readonly shot: ReadonlySignal<Shot>;
  readonly layer: ReadonlySignal<Layer>;
  readonly method: ReadonlySignal<Method | undefined>;
  readonly layerId: Signal<string>;
  readonly frame = signal(0);
  /** Whether the filmstrip shows the whole clip, to move the shot's in and out points. */
  readonly trimming = signal(false);
  /** The frames of the shot: those that can be shown. */
  readonly reach: ReadonlySignal<Span>;
  /** The frames that the filmstrip shows. */
  readonly span: Signal<Span>;
  readonly tool = signal<Tool>("pan");
  readonly brush: Session["brush"];
  readonly drawing: Session["drawing"];
  readonly paintLayer = signal("paint");
  /** The part of the layer that is painted on, if its method has several that are. */
  readonly paintPart = signal("");
  readonly view = signal<View>({ scale: 1, x: 0, y: 0 });
  /** Whether the playhead moves by itself. */
  readonly playing = signal(false);
  readonly stageView = signal<StageView>("compare");
  /** Where the wipe divides the picture, 0..1. */
  readonly split = signal(0.5);
  readonly region = signal("");
  readonly results = signal<ReadonlyMap<number, Result>>(new Map());
  /** Two variants of the shown frame, compared in the wipe. */
  readonly compared = signal<{ left: ImageBitmap; right: ImageBitmap } | null>(null);
  readonly neighbours = signal<readonly Result[]>([]);
  /** Frames that are worth a key, as the service found them. */
  readonly suggested = signal<readonly number[]>([]);
  /** First frames of all shots of the video but the first, as far as the service has found them. */
  readonly cuts = signal<readonly number[]>([]);
  /** The newest finished film of the shot. */
  readonly film = signal<Job | null>(null);
  /** Whether the service previews projects: regions, style cards and painted keys need it. */
  readonly previews = signal(false);
  readonly busy = signal("");
  readonly problem = signal("");
  readonly saving: Session["saving"];
  /** Painted keys that are not uploaded yet. */
  readonly uploading = signal(0);
  /** Changes whose pixels are being found: fills, objects and mattes. */
  readonly filling = signal(0);
  /** Corrected label maps that are not uploaded yet. */
  readonly storing = signal(0);
  /** Whether the service could not be reached when they were to be uploaded. */
  readonly uploadsWait = signal(false);

  /** `shotId`: the shot that is shown, `asset`: its clip. */
  constructor(
    readonly session: Session,
    readonly shotId: string,
    readonly asset: Asset,
  ) {
    const { document } = session;
    this.projectId = session.projectId;
    this.methods = session.methods;
    this.history = session.history;
    this.document = document;
    this.brush = session.brush;
    this.drawing = session.drawing;
    this.saving = session.saving;
    let last = must(shotOf(document.peek(), shotId));
    this.shot = computed(() => {
      last = shotOf(document.value, shotId) ?? last; // a shot that was removed is shown until another one is
      return last;
    });
    this.layerId = signal(last.layers.at(-1)?.id ?? "");
    this.layer = computed(() => layerOf(this.shot.value, this.layerId.value) ?? must(this.shot.value.layers.at(-1)));
    this.method = computed(() => this.methodOf(this.layer.value));
    this.reach = computed(() => (this.trimming.value ? [0, this.frames] : framesOf(this.shot.value, this.frames)));
    const [first, end] = this.reach.peek();
    this.span = signal([first, end]);
    this.frame.value = first + Math.floor((end - first) / 3);
  }

  methodOf(layer: Layer): Method | undefined {
    return this.methods.find((method) => method.name === layer.method);
  }

  /** The first section with this editor that the method of a layer, the selected one if none is given, has. */
  section(editor: Section["editor"], layer = this.layer.value): Section | undefined {
    return this.methodOf(layer)?.studio.sections.find((section) => section.editor === editor);
  }

  /** The first overlay of a kind that the method of a layer, the selected one if none is given, offers. */
  overlay(kind: Overlay["kind"], layer = this.layer.value): Overlay | undefined {
    const overlays = this.methodOf(layer)?.studio.sections.map((section) => section.overlay);
    return overlays?.find((overlay) => overlay?.kind === kind) ?? undefined;
  }

  /** The section whose part the brush paints on: of this part if it is one, else the first. */
  painted(layer = this.layer.value, part = this.paintPart.value): Section | undefined {
    const sections = this.methodOf(layer)?.studio.sections.filter(isPainted);
    return sections?.find((section) => section.part === part) ?? sections?.[0];
  }

  /** Paint on the part of this section from now on. */
  paint(section: Section): void {
    this.paintPart.value = section.part;
  }

  /** Key of the editable picture of the selected layer at a frame. */
  pictureKey(frame: number, section = this.painted()): string {
    return pictureKey(this.place, frame, section?.part ?? "");
  }

  /** The brush's colour: marks have no other ones than those of their section. */
  get brushColor(): string {
    const marks = this.painted()?.marks ?? [];
    const { color } = this.brush.value;
    return marks.find(({ colour }) => colour === color)?.colour ?? marks[0]?.colour ?? color;
  }

  /** The tip of the chosen tool; undefined: a plain line. Marks are plain, for they are data. */
  get tip(): Tip | undefined {
    if (this.painted()?.editor === "marks" || PLAIN_TOOLS.includes(this.tool.value)) return undefined;
    const { eraser, smudge } = this.drawing;
    if (this.tool.value === "eraser") return eraser.value.tip;
    return this.tool.value === "smudge" ? smudge.value.tip : this.brush.value.tip;
  }

  /** `size` in px; it is rounded and kept within its limits. */
  resizeBrush(size: number): void {
    const rounded = Math.min(MAX_BRUSH_PX, Math.max(1, Math.round(size)));
    this.brush.value = { ...this.brush.peek(), size: rounded };
  }

  /** Paint with the background colour, and keep the other one. */
  swapColours(): void {
    const { color } = this.brush.peek();
    this.brush.value = { ...this.brush.peek(), color: this.drawing.background.peek() };
    this.drawing.background.value = color;
  }

  /** Regions, styles and directions of the selected layer. */
  get design(): Design {
    const section = this.section("regions");
    return (section && (this.layer.value.parts?.[section.part] as Design | undefined)) ?? {};
  }

  /** Whether the film has lost this shot, so that another one is about to be shown. */
  get removed(): boolean {
    return !shotOf(this.document.value, this.shotId);
  }

  /** Of the clip. */
  get frames(): number {
    return Math.max(1, this.asset.info.frames ?? 1);
  }

  get fps(): number {
    return this.asset.info.fps || 25;
  }

  get size(): { width: number; height: number } {
    return { width: this.asset.info.width ?? 16, height: this.asset.info.height ?? 9 };
  }

  get place(): LayerPlace {
    return { shot: this.shot.value.id, layer: this.layer.value.id };
  }

  goTo(frame: number): void {
    const shown = clampFrame(frame, this.reach.value);
    this.span.value = spanWith(this.span.value, this.reach.value, shown);
    this.frame.value = shown;
  }

  /** One step of the user; steps of one group that follow within this time are joined. */
  edit(label: string, change: (state: State) => State, group = "", within = GROUP_MS): void {
    const history = this.history.value;
    this.history.value = record(history, label, change(history.present), { group, at: performance.now(), within });
  }

  /** One step that changes the document only. */
  editDocument(
    label: string,
    change: (document: ProjectDocument) => ProjectDocument,
    group = "",
    within = GROUP_MS,
  ): void {
    this.edit(label, (state) => ({ ...state, document: change(state.document) }), group, within);
  }

  /** One step that changes the selected layer. */
  editLayer(label: string, change: (layer: Layer) => Layer, group = "", within = GROUP_MS): void {
    const place = this.place;
    this.editDocument(label, (document) => changeLayer(document, place, change), group, within);
  }

  /** One step that changes one part of the selected layer. */
  editPart<Part>(label: string, part: string, change: (part: Part) => Part, group = "", within = GROUP_MS): void {
    const changed = (layer: Layer) => withPart(layer, part, change(layer.parts?.[part] as Part));
    this.editLayer(label, changed, group, within);
  }

  editDesign(label: string, change: (design: Design) => Design, group = "", within = GROUP_MS): void {
    const part = this.section("regions")?.part;
    if (part) this.editPart<Design | undefined>(label, part, (design = {}) => change(design), group, within);
  }

  /** The painting of a frame, if it is the film's picture with the present document. */
  presentResult(frame: number): Result | undefined {
    const result = this.results.value.get(frame);
    return result?.final && result.document === this.document.value ? result : undefined;
  }

  /** Forget the painting of a frame: it cannot be painted now. */
  dropResult(frame: number): void {
    const results = new Map(this.results.value);
    if (results.delete(frame)) this.results.value = results;
  }

  /** Show a painted frame; older ones of the same frame are replaced, and at most `most` are kept. */
  showResult(result: Result, most = 60): void {
    const results = new Map(this.results.value);
    results.delete(result.frame);
    results.set(result.frame, result);
    for (const frame of results.keys()) if (results.size > most) results.delete(frame);
    this.results.value = results;
  }
}

function must<T>(value: T | undefined): T {
  if (value === undefined) throw new Error("The project has no shot or no layer.");
  return value;
}

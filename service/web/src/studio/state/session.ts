/**
 * What the shots of an open project share: the document with its history, the brush, and which shot is shown. Each visit of
 * a shot has a `Store` of its own.
 */

import { computed, type ReadonlySignal, type Signal, signal } from "@preact/signals";
import * as api from "../../api/api";
import type { Asset, Method } from "../../api/schemas";
import type { Project } from "../document/api";
import type { SaveState } from "../document/autosave";
import { type ProjectDocument, shotOf } from "../document/document";
import type { Brush } from "../document/looks";
import { changedShot } from "../document/shots";
import { type History, record, redo, startHistory, undo } from "../document/undo";
import { DrawingSettings } from "../drawing/settings";
import type { KeyPicture } from "../drawing/strokes";

/** What undo restores: the document and the editable pictures of painted keys and marks, by `pictureKey`. */
export interface State {
  document: ProjectDocument;
  pictures: Readonly<Record<string, KeyPicture>>;
}

export class Session {
  readonly projectId: string;
  readonly history: Signal<History<State>>;
  readonly document: ReadonlySignal<ProjectDocument>;
  /** The shot that is shown, or is to be shown once its clip is known. */
  readonly shotId: Signal<string>;
  /** A frame of a shot that is to be shown as soon as the shot is. */
  readonly wanted = signal<{ shot: string; frame: number } | null>(null);
  readonly brush = signal<Brush>({ color: "#b43c25", size: 24, opacity: 1 });
  readonly drawing = new DrawingSettings();
  readonly saving = signal<SaveState>({ name: "saved" });
  /** Pictures that are uploaded and in the document. */
  readonly uploaded = new WeakSet<KeyPicture>();
  private readonly assets = new Map<string, Promise<Asset>>();

  constructor(
    project: Project,
    readonly methods: readonly Method[],
    shot = "",
  ) {
    const { document } = project;
    this.projectId = project.id;
    this.history = signal(startHistory<State>({ document, pictures: {} }));
    this.document = computed(() => this.history.value.present.document);
    this.shotId = signal((shotOf(document, shot) ?? document.shots[0])?.id ?? "");
  }

  /** Show the shot that is so many places after the shown one, if there is one. */
  step(by: number): void {
    const { shots } = this.document.peek();
    const next = shots[shots.findIndex(({ id }) => id === this.shotId.peek()) + by];
    if (next) this.shotId.value = next.id;
  }

  /** Show a frame of a shot. */
  show(shot: string, frame: number): void {
    this.wanted.value = { shot, frame };
    this.shotId.value = shot;
  }

  /** The clip of a shot; it is asked for once. */
  clip(shot: string): Promise<Asset> {
    const { assets } = this.document.peek();
    return this.asset(assets[shotOf(this.document.peek(), shot)?.video ?? ""]?.id ?? "");
  }

  asset(id: string): Promise<Asset> {
    const known = this.assets.get(id) ?? api.asset(id);
    this.assets.set(id, known);
    known.catch(() => this.assets.delete(id));
    return known;
  }

  /** Pictures of any shot that are not uploaded yet. */
  pending(): Record<string, KeyPicture> {
    const all = Object.entries(this.history.value.present.pictures);
    return Object.fromEntries(all.filter(([, picture]) => !this.uploaded.has(picture)));
  }

  /** One step that changes the document. */
  edit(label: string, change: (document: ProjectDocument) => ProjectDocument, group = ""): void {
    const { present } = this.history.value;
    const state = { ...present, document: change(present.document) };
    if (state.document === present.document) return;
    this.history.value = record(this.history.value, label, state, { group, at: performance.now() });
  }

  undo(): void {
    this.travel(undo(this.history.value));
  }

  redo(): void {
    this.travel(redo(this.history.value));
  }

  /** Show another state of the history, and in it the shot that changes: no change is out of sight. */
  private travel(history: History<State>): void {
    const [before, after] = [this.history.value.present, history.present];
    this.history.value = history;
    const painted = Object.keys({ ...before.pictures, ...after.pictures }).find(
      (key) => before.pictures[key] !== after.pictures[key],
    );
    const shown = shotOf(after.document, this.shotId.peek());
    const same = shown && shown === shotOf(before.document, this.shotId.peek());
    const changed = changedShot(before.document, after.document) || (painted && shotOfPicture(painted));
    if (same && changed && shotOf(after.document, changed)) this.shotId.value = changed;
  }
}

/** The shot of a `pictureKey`; empty in what versions without films have kept in the browser. */
export const shotOfPicture = (key: string): string => key.split("/").slice(0, -1).join();

/** The studio: stage, tools, filmstrip and panel of one project, kept together. */

import { effect, untracked } from "@preact/signals";
import { useEffect, useRef, useState } from "preact/hooks";
import * as shared from "../../api/api";
import { under } from "../../api/base";
import type { Asset, Method } from "../../api/schemas";
import { notify } from "../../ui/notices";
import { ClusterLane } from "../clusters/cluster-lane";
import { Clusters } from "../clusters/clusters";
import { createLabelTool } from "../clusters/label-tool";
import { type Project, readProject, saveProject } from "../document/api";
import { createSaver, type Saver } from "../document/autosave";
import { type ProjectDocument, pruneAssets, shownAlone } from "../document/document";
import { type FilmFrame, Films, filmFrame } from "../films/films";
import { Filmstrip } from "../films/filmstrip";
import { Flicker } from "../films/flicker";
import { FlickerLane } from "../films/flicker-lane";
import { createPlayback, type Playback } from "../films/playback";
import { Foreground } from "../keys/foreground";
import { PaintedKeys } from "../keys/keys";
import { type Neighbours, startNeighbours } from "../keys/neighbours";
import { createPaintTool, type PaintTool } from "../keys/paint-tool";
import { type Cuts, followCuts } from "../previews/cuts";
import { type FrameSource, openFrames } from "../previews/frames";
import { type Previews, startPreviews } from "../previews/previews";
import { type ScrubFrames, startScrubbing } from "../previews/scrub";
import { createDirectionTool } from "../regions/direction-tool";
import { createLassoTool, createRegionTool, type RegionTool } from "../regions/region-tool";
import { StyleLane } from "../regions/style-lane";
import { createLoupeTool } from "../stage/loupe-tool";
import { mountStage, type Stage, type StageParts } from "../stage/stage";
import { PAINT_TOOLS, type State, Store, type Tool } from "../state/store";
import { dropUnsaved, readUnsaved, type Unsaved, versionFollowed, writeUnsaved } from "../state/unsaved";
import { installShortcuts } from "../tools/shortcuts";
import { StageBar, Toolbar, toolsOf } from "../tools/toolbar";
import { Panel } from "./panel";
import { ProjectMenu } from "./project-menu";
import { SaveStatus } from "./save-status";

/** A frame that is shown small already is sought once the playhead rests: seeking takes the processor. */
const SEEK_REST_MS = 150;

class Designer {
  readonly store: Store;
  readonly frames: FrameSource;
  readonly scrub: ScrubFrames;
  readonly films: Films;
  readonly keys: PaintedKeys;
  readonly paint: PaintTool;
  readonly regions: RegionTool;
  readonly clusters: Clusters;
  readonly flicker: Flicker;
  readonly foreground: Foreground;
  readonly parts: StageParts;
  readonly playback: Playback;
  readonly cuts: Cuts;
  readonly saver: Saver;
  stage: Stage | null = null;
  private readonly previews: Previews;
  private readonly neighbours: Neighbours;
  private prepared = false;
  private seeking = 0;
  private readonly restored: Unsaved | null;
  /** The document, while it is not saved. */
  private unsaved: ProjectDocument | null = null;
  private sent: ProjectDocument | undefined;
  private readonly closers: (() => void)[] = [];

  constructor(project: Project, asset: Asset, methods: readonly Method[]) {
    const redraw = () => this.stage?.redraw();
    const store = new Store(project, asset, methods);
    this.store = store;
    this.frames = openFrames(asset, redraw);
    this.scrub = startScrubbing(store, redraw);
    this.films = new Films(store, redraw);
    this.keys = new PaintedKeys(store, this.frames, notify);
    this.paint = createPaintTool(store, this.keys, redraw, () => this.keepUnsaved());
    this.regions = createRegionTool(store, redraw);
    this.clusters = new Clusters(store, notify, redraw);
    this.flicker = new Flicker(store, redraw);
    this.foreground = new Foreground(store, redraw);
    const tools = {
      loupe: createLoupeTool(store, redraw),
      label: createLabelTool(store, this.clusters, redraw),
      region: this.regions,
      lasso: createLassoTool(store, redraw),
      direction: createDirectionTool(store, redraw),
    };
    const overlays = [this.flicker, this.foreground, this.clusters].map(
      (part) => (context: CanvasRenderingContext2D) => part.draw(context),
    );
    const { frames, scrub, films, keys, paint } = this;
    this.parts = { store, frames, scrub, films, keys, paint, tools, overlays };
    this.playback = createPlayback(store, films);
    this.cuts = followCuts(store);
    this.restored = readUnsaved(project.id);
    this.saver = this.startSaving(project);
    this.previews = startPreviews(store);
    this.neighbours = startNeighbours(store, this.keys);
    films.find().catch(notify);
    this.closers.push(this.followFrame(), this.followDocument());
    const shortcuts = {
      store,
      stage: () => this.stage,
      playback: this.playback,
      tools: () => [
        ...(store.previews.value ? (["loupe"] as const) : []),
        ...toolsOf(store, store.previews.value, this.clusters.available.value),
      ],
    };
    this.closers.push(installShortcuts(shortcuts));
    if (this.restored) store.edit("Restore unsaved changes", (state) => withUnsaved(state, this.restored));
    this.closers.push(
      this.keepWhenClosed(),
      effect(() => this.keepUnsaved()),
    );
  }

  /** Unsaved changes that follow another version than the stored one are a conflict, which the page shows. */
  private startSaving(project: Project): Saver {
    return createSaver({
      version: this.restored ? versionFollowed(this.restored, project) : project.version,
      document: project.document,
      save: (document, version) => this.save(pruneAssets(document), version),
      asProblem: shared.asProblem,
      onstate: (state) => {
        this.store.saving.value = state;
      },
      keep: (document) => {
        this.unsaved = document;
        this.keepUnsaved();
      },
    });
  }

  /** Save; a version with the very same document, of which the answer was lost, is as good. */
  private async save(document: ProjectDocument, version: number): Promise<number> {
    this.sent = document;
    this.keepUnsaved();
    try {
      return await saveProject(this.store.projectId, document, version);
    } catch (error) {
      if (!(error instanceof shared.Problem) || error.status !== 412) throw error;
      const stored = await readProject(this.store.projectId);
      if (JSON.stringify(stored.document) !== JSON.stringify(document)) throw error;
      return stored.version;
    }
  }

  private keepUnsaved(): void {
    const { projectId, document } = this.store;
    const pictures = { ...this.keys.pending(), ...untracked(() => this.paint.unfinished()) };
    if (!this.unsaved && !Object.keys(pictures).length) {
      dropUnsaved(projectId);
      return;
    }
    const present = this.unsaved ?? document.peek();
    const unsaved = { version: this.saver?.version ?? 0, document: present, sent: this.sent, pictures };
    try {
      writeUnsaved(projectId, unsaved);
    } catch (error) {
      console.info("Impasto: this browser has no room for unsaved changes.", error);
    }
  }

  /** A stroke under the pen is kept, too, when the page closes. */
  private keepWhenClosed(): () => void {
    const settle = () => this.paint.settle();
    window.addEventListener("pagehide", settle);
    return () => window.removeEventListener("pagehide", settle);
  }

  private followDocument(): () => void {
    return effect(() => this.saver.changed(this.store.document.value));
  }

  /** Show the frame, and load its data for the tool. */
  private followFrame(): () => void {
    const { store } = this;
    return effect(() => {
      const frame = store.frame.value;
      const tool = store.tool.value;
      store.layerId.value;
      store.paintPart.value;
      untracked(() => this.showFrame(frame, tool));
    });
  }

  private showFrame(frame: number, tool: Tool): void {
    this.scrub.moved(frame);
    clearTimeout(this.seeking);
    if (this.scrub.at(frame)) this.seeking = window.setTimeout(() => this.frames.seek(frame), SEEK_REST_MS);
    else this.frames.seek(frame);
    if (PAINT_TOOLS.includes(tool)) {
      this.paint.prepare(frame);
      this.prepareNeighbours(frame);
    }
    if (tool === "region") this.regions.load(frame);
  }

  /** Once per visit: the first repainting of neighbours is slow, so that it is begun before the first stroke. */
  private prepareNeighbours(frame: number): void {
    if (this.prepared || this.store.painted(this.store.layer.peek())?.editor !== "keys") return;
    this.prepared = true;
    this.neighbours
      .prepare(frame)
      .catch((error) => shared.isAbort(error) || console.info("Impasto: no preparation.", error));
  }

  /** Make the present painting of the shown frame a key, for corrections. */
  async correctFrame(): Promise<void> {
    const { store } = this;
    const frame = store.frame.value;
    const key = store.pictureKey(frame, store.section("keys"));
    await this.keys.correct(frame, await this.previews.full(frame), key);
    if (store.frame.value === frame) store.tool.value = "brush";
  }

  /** Make a frame of a finished film a key, for corrections. */
  async takeFromFilm(wanted: FilmFrame): Promise<void> {
    const { store } = this;
    store.goTo(wanted.frame);
    const key = store.pictureKey(wanted.frame, store.section("keys"));
    await this.keys.correct(wanted.frame, await filmFrame(wanted), key);
    if (store.frame.value === wanted.frame) store.tool.value = "brush";
  }

  /** Show the present frame as the film will have it, at the video's size. */
  async showFull(): Promise<void> {
    const { frame, document, shot, layerId } = this.store;
    const shown = { frame: frame.value, document: document.value, layer: shownAlone(shot.value, layerId.value) };
    const picture = await createImageBitmap(await this.previews.full(shown.frame));
    this.store.showResult({ ...shown, picture, scale: 1, final: true });
  }

  suggestKeys(): Promise<void> {
    return this.previews.suggest();
  }

  async saveAll(): Promise<boolean> {
    await this.keys.flush();
    await this.clusters.settled();
    return (await this.saver.flush()) && !this.store.uploading.value;
  }

  close(): void {
    this.saveAll().catch(notify);
    for (const close of this.closers) close();
    this.playback.stop();
    this.previews.close();
    this.neighbours.close();
    this.keys.close();
    this.films.close();
    this.saver.close();
    this.cuts.close();
    this.clusters.close();
    this.flicker.close();
    this.foreground.close();
    clearTimeout(this.seeking);
    this.scrub.close();
    this.frames.close();
    this.stage?.close();
  }
}

const withUnsaved = (state: State, unsaved: Unsaved | null): State =>
  unsaved ? { document: unsaved.document, pictures: { ...state.pictures, ...unsaved.pictures } } : state;

/**
 * The stored project. Changes that this browser kept for a page of an earlier schema are saved first: the service writes
 * them in the present one. If another version is stored, they are a conflict, which the page shows.
 */
export async function openProject(id: string): Promise<Project> {
  const project = await readProject(id);
  const unsaved = readUnsaved(id);
  if (!unsaved || unsaved.document.schema === project.document.schema) return project;
  try {
    const version = await saveProject(id, unsaved.document, unsaved.version);
    const saved = await readProject(id);
    writeUnsaved(id, { version, document: saved.document, pictures: unsaved.pictures });
    return saved;
  } catch (error) {
    if (!(error instanceof shared.Problem) || error.status !== 412) throw error;
    return project;
  }
}

export interface StudioPageProps {
  project: Project;
  asset: Asset;
  methods: readonly Method[];
  /** Open the project anew. */
  reload(): void;
  /** A frame of a finished film that becomes a key at once. */
  take?: FilmFrame | undefined;
}

export function StudioPage({ project, asset, methods, reload, take }: StudioPageProps) {
  const [designer] = useState(() => new Designer(project, asset, methods));
  useEffect(() => {
    if (take) designer.takeFromFilm(take).catch(notify);
    return () => designer.close();
  }, []);
  return (
    <div class="designer">
      <DesignerPage designer={designer} reload={reload} />
    </div>
  );
}

function DesignerPage({ designer, reload }: { designer: Designer; reload(): void }) {
  const { store } = designer;
  const discard = () => {
    dropUnsaved(store.projectId);
    reload();
  };
  return (
    <>
      <div class="designer-main">
        <header class="designer-head">
          <ProjectName store={store} />
          <a class="button quiet small guide-link" href={under("/docs/shot")} target="_blank" rel="noopener">
            Guide: paint a shot in ten minutes
          </a>
          <ProjectMenu store={store} saver={designer.saver} saveAll={() => designer.saveAll()} reload={discard} />
          <SaveStatus store={store} saver={designer.saver} reload={discard} />
          {store.asset.info.damage && (
            <p class="field-error source-damage" role="note">
              {store.asset.info.damage} What can be read of it is painted; choose an undamaged copy if you have one.
            </p>
          )}
        </header>
        <StageBar store={store} films={designer.films} onfull={() => designer.showFull().catch(notify)} />
        <div class="designer-stage" style={{ "--ratio": store.size.width / store.size.height }}>
          <Toolbar store={store} clusters={designer.clusters} stage={() => designer.stage} />
          <StageCanvas designer={designer} />
        </div>
        <Filmstrip
          store={store}
          playback={designer.playback}
          cuts={designer.cuts}
          lane={
            <>
              <ClusterLane store={store} clusters={designer.clusters} />
              <StyleLane store={store} />
              <FlickerLane store={store} flicker={designer.flicker} />
            </>
          }
        />
      </div>
      <Panel
        store={store}
        films={designer.films}
        keys={designer.keys}
        clusters={designer.clusters}
        foreground={designer.foreground}
        saveAll={() => designer.saveAll()}
        correct={() => designer.correctFrame()}
        take={(frame) => designer.takeFromFilm(frame)}
        suggest={() => designer.suggestKeys()}
      />
    </>
  );
}

function ProjectName({ store }: { store: Store }) {
  const change = (event: Event) => {
    const name = (event.currentTarget as HTMLInputElement).value.trim();
    if (name) store.editDocument("Rename the project", (document) => ({ ...document, name }));
  };
  return (
    <h1>
      <input
        type="text"
        class="project-name"
        aria-label="Name of the project"
        maxLength={200}
        value={store.document.value.name}
        onChange={change}
      />
    </h1>
  );
}

function StageCanvas({ designer }: { designer: Designer }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    if (!canvas.current) return;
    designer.stage = mountStage(canvas.current, designer.parts);
    return () => designer.stage?.close();
  }, []);
  return (
    <canvas
      ref={canvas}
      class="stage-canvas"
      tabIndex={0}
      role="img"
      aria-label={`Stage: frame ${designer.store.frame.value + 1}`}
    />
  );
}

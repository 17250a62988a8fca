/** What the studio has for the shot that it shows: frames, tools, previews and playback, kept together. */

import { effect, untracked } from "@preact/signals";
import * as shared from "../../api/api";
import type { Asset } from "../../api/schemas";
import { notify } from "../../ui/notices";
import { Clusters } from "../clusters/clusters";
import { createLabelTool } from "../clusters/label-tool";
import { shownAlone } from "../document/document";
import type { Film } from "../films/film";
import { toggleFilm } from "../films/film-bar";
import type { FilmPlayer } from "../films/film-player";
import { type FilmFrame, Films, filmFrame } from "../films/films";
import { Flicker } from "../films/flicker";
import { createPlayback, type Playback } from "../films/playback";
import { Foreground } from "../keys/foreground";
import { KeyActions } from "../keys/key-actions";
import { acceptKeys, askScaling, withoutKey } from "../keys/key-input";
import { PaintedKeys } from "../keys/keys";
import { LayerMatte } from "../keys/matte";
import { type Neighbours, startNeighbours } from "../keys/neighbours";
import { createObjectTool } from "../keys/object-tool";
import { createPaintTool, type PaintTool } from "../keys/paint-tool";
import { createSelectTool } from "../keys/select-tool";
import { type Cuts, followCuts } from "../previews/cuts";
import { type FilmSource, openFrames } from "../previews/frames";
import { type Previews, startPreviews } from "../previews/previews";
import { type ScrubFrames, startScrubbing } from "../previews/scrub";
import { createCorrectionTool } from "../regions/correction-tool";
import { createDirectionTool, followField } from "../regions/direction-tool";
import type { FilmView } from "../regions/film-view";
import { RegionMaps } from "../regions/region-map";
import { createLassoTool, createRegionTool, type RegionTool, segmentationShown } from "../regions/region-tool";
import { createTrueField, type Field } from "../regions/true-field";
import { createLoupeTool } from "../stage/loupe-tool";
import { createOnionSkin, type OnionSkin } from "../stage/onion-skin";
import type { Stage, StageParts } from "../stage/stage";
import type { Session } from "../state/session";
import { MATTE_TOOLS, PAINT_TOOLS, Store, type Tool } from "../state/store";
import { installShortcuts } from "../tools/shortcuts";
import { toolsOf } from "../tools/toolbar";
import type { Saving } from "./saving";

/** A frame that is shown small already is sought once the playhead rests: seeking takes the processor. */
const SEEK_REST_MS = 150;

/** What the shots of a film share. */
export interface FilmParts {
  session: Session;
  saving: Saving;
  film: Film;
  player: FilmPlayer;
}

export class Designer {
  readonly store: Store;
  readonly frames: FilmSource;
  readonly scrub: ScrubFrames;
  readonly films: Films;
  readonly keys: PaintedKeys;
  readonly actions: KeyActions;
  readonly paint: PaintTool;
  readonly regionMaps: RegionMaps;
  readonly regions: RegionTool;
  readonly field: FilmView<Field>;
  readonly clusters: Clusters;
  readonly flicker: Flicker;
  readonly foreground: Foreground;
  readonly matte: LayerMatte;
  readonly onion: OnionSkin;
  readonly parts: StageParts;
  readonly playback: Playback;
  readonly cuts: Cuts;
  stage: Stage | null = null;
  private readonly previews: Previews;
  private readonly neighbours: Neighbours;
  private prepared = false;
  private seeking = 0;
  private readonly closers: (() => void)[] = [];

  private readonly saving: Saving;

  /** `before`: what the stage has shown, which stays there until the shot has a picture. */
  constructor({ session, saving, film, player }: FilmParts, shot: string, asset: Asset, before?: HTMLCanvasElement) {
    this.saving = saving;
    const redraw = () => this.stage?.redraw();
    const store = new Store(session, shot, asset);
    this.store = store;
    this.frames = openFrames(asset, redraw);
    this.scrub = startScrubbing(store, redraw);
    this.films = new Films(store, film, redraw);
    this.keys = new PaintedKeys(store, this.frames, redraw, notify);
    this.actions = new KeyActions(store, this.keys, askScaling);
    this.paint = createPaintTool(store, this.keys, redraw, () => saving.keep());
    const select = createSelectTool(store, this.keys, this.paint, redraw);
    this.regionMaps = new RegionMaps(store, redraw);
    this.regions = createRegionTool(store, this.regionMaps, redraw);
    this.field = createTrueField(store, redraw);
    this.clusters = new Clusters(store, notify, redraw);
    this.flicker = new Flicker(store, redraw);
    this.foreground = new Foreground(store, redraw);
    this.matte = new LayerMatte(store, redraw);
    this.onion = createOnionSkin(store, redraw);
    const tools = {
      ...{ rectangle: select, outline: select, transform: select },
      loupe: createLoupeTool(store, redraw),
      object: createObjectTool(store, this.keys, this.paint, redraw),
      ...this.matte.tools,
      label: createLabelTool(store, this.clusters, redraw),
      region: this.regions,
      lasso: createLassoTool(store, redraw),
      correct: createCorrectionTool(store, redraw),
      direction: createDirectionTool(store, this.field, redraw),
    };
    const overlays = [
      ...[this.flicker, this.foreground, this.clusters, this.matte].map(
        (part) => (context: CanvasRenderingContext2D) => part.draw(context),
      ),
      this.regions.drawAll,
      (context: CanvasRenderingContext2D) => this.regionMaps.draw(context),
    ];
    const { frames, scrub, films, keys, paint, onion } = this;
    this.parts = { store, frames, scrub, films, keys, paint, tools, onion, overlays, before };
    this.playback = createPlayback(store, films, frames);
    this.cuts = followCuts(store);
    saving.pictures = () => ({ ...session.pending(), ...untracked(() => this.paint.unfinished()) });
    this.previews = startPreviews(store);
    this.keys.bases.paint = (frame) => this.previews.look(frame, withoutKey(store, frame));
    this.neighbours = startNeighbours(store, this.keys);
    films.find().catch(notify);
    this.closers.push(followField(this.field));
    this.closers.push(this.followFrame(), this.followReach(), this.followWanted());
    const shortcuts = {
      store,
      stage: () => this.stage,
      playback: this.playback,
      player,
      playFilm: () => toggleFilm(player, store, this.playback),
      select,
      paint: () => void films.submit(() => this.saveAll()).catch(notify),
      tools: () => [
        ...(store.previews.value ? ["loupe" as const, ...MATTE_TOOLS] : []),
        ...toolsOf(store, store.previews.value, this.clusters.available.value),
      ],
    };
    this.closers.push(installShortcuts(shortcuts));
    this.closers.push(
      this.keepWhenClosed(),
      acceptKeys(store, this.actions),
      effect(() => saving.keep()),
      effect(() => {
        if (this.playback.speed.value) untracked(() => player.stop()); // the shot is played instead of the film
      }),
    );
  }

  /** A stroke under the pen is kept, too, when the page closes. */
  private keepWhenClosed(): () => void {
    const settle = () => void this.paint.settle();
    window.addEventListener("pagehide", settle);
    return () => window.removeEventListener("pagehide", settle);
  }

  /** The playhead and the filmstrip stay within the shot, whose in and out points may change. */
  private followReach(): () => void {
    const { store } = this;
    let before = store.reach.peek();
    return effect(() => {
      const reach = store.reach.value;
      if (reach.join() === before.join()) return;
      before = reach;
      untracked(() => {
        store.span.value = reach;
        store.goTo(store.frame.value);
      });
    });
  }

  /** Show the frame of this shot that another part of the page asks for. */
  private followWanted(): () => void {
    const { store } = this;
    return effect(() => {
      const wanted = store.session.wanted.value;
      if (wanted?.shot !== store.shotId) return;
      untracked(() => store.goTo(wanted.frame));
      store.session.wanted.value = null;
    });
  }

  /** Show the frame, and load its data for the tool. */
  private followFrame(): () => void {
    const { store } = this;
    return effect(() => {
      const frame = store.frame.value;
      const tool = store.tool.value;
      store.layerId.value;
      store.paintPart.value;
      segmentationShown.value;
      untracked(() => this.showFrame(frame, tool));
      this.stage?.redraw();
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
    if (tool === "region" || (segmentationShown.value && this.store.section("regions"))) this.regions.load(frame);
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

  /** Upload what is painted on this shot; false if the service does not answer. */
  async settle(): Promise<boolean> {
    await this.paint.settle();
    await this.keys.flush();
    await this.clusters.settled();
    return !this.store.uploading.value;
  }

  async saveAll(): Promise<boolean> {
    await this.settle();
    return (await this.saving.saver.flush()) && !Object.keys(this.store.session.pending()).length;
  }

  close(): void {
    this.saveAll().catch(notify);
    this.saving.pictures = () => this.store.session.pending();
    for (const close of this.closers) close();
    this.playback.close();
    this.previews.close();
    this.neighbours.close();
    this.keys.close();
    this.films.close();
    this.cuts.close();
    this.clusters.close();
    this.flicker.close();
    this.foreground.close();
    this.matte.close();
    this.regionMaps.close();
    this.field.close();
    this.onion.close();
    clearTimeout(this.seeking);
    this.scrub.close();
    this.frames.close();
    this.stage?.close();
  }
}

/** The studio: stage, tools, filmstrip and panel of the shown shot, and the shots of the film. */

import { effect } from "@preact/signals";
import { useEffect, useRef, useState } from "preact/hooks";
import { Problem } from "../../api/api";
import { under } from "../../api/base";
import type { Asset, Method } from "../../api/schemas";
import { IconButton } from "../../ui/icons";
import { notify } from "../../ui/notices";
import { ClusterLane } from "../clusters/cluster-lane";
import type { Project } from "../document/api";
import { createCanvas } from "../drawing/canvas";
import { Comments } from "../films/comments";
import { Film } from "../films/film";
import { FilmPlayer } from "../films/film-player";
import { FilmScreen } from "../films/film-screen";
import type { FilmFrame } from "../films/films";
import { Filmstrip } from "../films/filmstrip";
import { FlickerLane } from "../films/flicker-lane";
import { NotesList } from "../films/notes-list";
import { ShotBar } from "../films/shot-bar";
import { StyleLane } from "../regions/style-lane";
import { mountStage } from "../stage/stage";
import { keyText } from "../state/key-bindings";
import { Session } from "../state/session";
import type { Store } from "../state/store";
import { dropUnsaved } from "../state/unsaved";
import { DrawingPanel } from "../tools/drawing-panel";
import { ShortcutList } from "../tools/shortcut-list";
import { listOpen, panelHidden } from "../tools/shortcuts";
import { StageBar } from "../tools/stage-bar";
import { Toolbar } from "../tools/toolbar";
import { Designer, type FilmParts } from "./designer";
import { Panel } from "./panel";
import { ProjectMenu } from "./project-menu";
import { SaveStatus } from "./save-status";
import { Saving } from "./saving";

export interface StudioPageProps {
  project: Project;
  /** Of the project, with the clip of its shown shot at hand. */
  session: Session;
  clip: Asset;
  /** Open the project anew. */
  reload(): void;
  /** A frame of a finished film that becomes a key at once. */
  take?: FilmFrame | undefined;
}

export function StudioPage({ project, session, clip, reload, take }: StudioPageProps) {
  const [saving] = useState(() => new Saving(session, project));
  const [film] = useState(() => new Film(session));
  const [player] = useState(() => new FilmPlayer(session, film));
  const [comments] = useState(() => new Comments(project.id));
  const designer = useDesigner({ session, saving, film, player, clip });
  useEffect(() => {
    if (take) designer.takeFromFilm(take).catch(notify);
    return () => {
      saving.close();
      player.close();
      comments.close();
      film.close();
    };
  }, []);
  return (
    <div class={`designer ${panelHidden.value ? "wide" : ""} ${session.drawing.alone.value ? "alone" : ""}`}>
      <DesignerPage
        key={designer.store.shotId}
        designer={designer}
        saving={saving}
        film={film}
        player={player}
        comments={comments}
        reload={reload}
      />
      <ShortcutList />
      <ShotBar
        session={session}
        film={film}
        player={player}
        cuts={designer.cuts}
        store={designer.store}
        playback={designer.playback}
      />
    </div>
  );
}

const shotMemory = (project: string): string => `impasto.shot:${project}`;

/** A session that shows the shot of a name, else the one that was shown last in this tab; and the clip of that shot. */
export async function openSession(
  project: Project,
  methods: readonly Method[],
  shot = "",
): Promise<{ session: Session; clip: Asset }> {
  const session = new Session(project, methods, shot || (sessionStorage.getItem(shotMemory(project.id)) ?? ""));
  return { session, clip: await session.clip(session.shotId.peek()) };
}

/** The designer of the shown shot. What is painted on a shot is uploaded before another one is shown. */
function useDesigner({ clip, ...film }: FilmParts & { clip: Asset }): Designer {
  const { session } = film;
  const [designer, setDesigner] = useState(() => new Designer(film, session.shotId.peek(), clip));
  useEffect(() => {
    let shown = designer;
    let last: Promise<unknown> = Promise.resolve();
    let closed = false;
    const show = async () => {
      const shot = session.shotId.peek();
      if (closed || shot === shown.store.shotId) return;
      const asset = await session.clip(shot);
      if (!(await shown.settle()))
        throw new Problem({
          detail: "The other shot is not shown: what was painted on this one is not uploaded.",
          remedy: "It is kept in this browser. Choose the shot again when the service answers.",
        });
      if (closed || session.shotId.peek() !== shot) return;
      const next = new Designer(film, shot, asset, stageNow());
      next.store.stageView.value = shown.store.stageView.peek();
      shown.close();
      shown = next;
      setDesigner(next);
      sessionStorage.setItem(shotMemory(session.projectId), shot);
    };
    const dispose = effect(() => {
      session.shotId.value;
      last = last.then(show).catch((error) => {
        session.shotId.value = shown.store.shotId;
        notify(error);
      });
    });
    const disposeLost = followLostShot(session);
    return () => {
      closed = true;
      dispose();
      disposeLost();
      shown.close();
    };
  }, []);
  return designer;
}

/** A copy of what the stage shows; undefined: it shows nothing. */
function stageNow(): HTMLCanvasElement | undefined {
  const shown = document.querySelector<HTMLCanvasElement>(".stage-canvas");
  if (!shown?.width) return undefined;
  const [copy, context] = createCanvas(shown);
  context.drawImage(shown, 0, 0);
  return copy;
}

/** When the shown shot is removed, show the one in its place. */
function followLostShot(session: Session): () => void {
  let index = 0;
  return effect(() => {
    const { shots } = session.document.value;
    const at = shots.findIndex(({ id }) => id === session.shotId.value);
    if (at >= 0) index = at;
    else session.shotId.value = shots[Math.min(index, shots.length - 1)]?.id ?? "";
  });
}

interface DesignerPageProps {
  designer: Designer;
  saving: Saving;
  film: Film;
  player: FilmPlayer;
  comments: Comments;
  reload(): void;
}

function DesignerPage({ designer, saving, film, player, comments, reload }: DesignerPageProps) {
  const { store } = designer;
  const { saver } = saving;
  const discard = () => {
    dropUnsaved(store.projectId);
    reload();
  };
  return (
    <>
      <div class="designer-main">
        <button type="button" class="button skip" onClick={skipToPaint}>
          Skip to painting
        </button>
        <header class="designer-head">
          <ProjectName store={store} />
          <a class="button quiet small guide-link" href={under("/docs/shot")} target="_blank" rel="noopener">
            Guide: paint a shot in ten minutes
          </a>
          <ProjectMenu store={store} saver={saver} saveAll={() => designer.saveAll()} reload={discard} />
          <NotesList session={store.session} comments={comments} />
          <IconButton
            name="keys"
            label="Keys of the studio"
            keys={keyText("list")}
            onClick={() => {
              listOpen.value = true;
            }}
          />
          <IconButton
            name="panel"
            label={panelHidden.value ? "Show the panel" : "Hide the panel"}
            keys={keyText("panel")}
            pressed={!panelHidden.value}
            onClick={() => {
              panelHidden.value = !panelHidden.value;
            }}
          />
          <SaveStatus store={store} saver={saver} reload={discard} />
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
          <FilmScreen player={player} session={store.session} />
          <DrawingPanel store={store} keys={designer.keys} />
        </div>
        <Filmstrip
          store={store}
          playback={designer.playback}
          cuts={designer.cuts}
          comments={comments}
          movekey={(from, to, copy) => designer.actions.carry(from, to, copy).catch(notify)}
          lane={
            <>
              <ClusterLane store={store} clusters={designer.clusters} />
              <StyleLane store={store} />
              <FlickerLane store={store} flicker={designer.flicker} />
            </>
          }
        />
      </div>
      {!panelHidden.value && (
        <Panel
          store={store}
          film={film}
          films={designer.films}
          keys={designer.keys}
          actions={designer.actions}
          clusters={designer.clusters}
          foreground={designer.foreground}
          matte={designer.matte}
          maps={designer.regionMaps}
          field={designer.field}
          saveAll={() => designer.saveAll()}
          correct={() => designer.correctFrame()}
          take={(frame) => designer.takeFromFilm(frame)}
          suggest={() => designer.suggestKeys()}
        />
      )}
    </>
  );
}

function skipToPaint(): void {
  panelHidden.value = false;
  requestAnimationFrame(() => document.querySelector<HTMLElement>(".designer-submit .submit")?.focus());
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
    <div class="stage-place">
      <canvas
        ref={canvas}
        class="stage-canvas"
        tabIndex={0}
        role="img"
        aria-label={`Stage: frame ${designer.store.frame.value + 1}`}
      />
    </div>
  );
}

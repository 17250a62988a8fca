/** The shots of the film in order: shown, reordered by dragging or by keys, copied, cut, removed; clips are added here. */

import { useEffect, useRef, useState } from "preact/hooks";
import type { Asset } from "../../api/schemas";
import { ACCEPT, useDrops } from "../../forms/dropzone";
import { duration, percent } from "../../ui/format";
import { Icon, IconButton } from "../../ui/icons";
import { announce, notify } from "../../ui/notices";
import { upload } from "../../ui/upload";
import type { Shot } from "../document/document";
import * as edits from "../document/shots";
import type { Cuts } from "../previews/cuts";
import type { Session } from "../state/session";
import type { Store } from "../state/store";
import type { Film } from "./film";
import { FilmBar } from "./film-bar";
import type { FilmPlayer } from "./film-player";
import { thumbnail } from "./filmstrip";
import type { Playback } from "./playback";

/** A pointer that moves less than this selects. */
const DRAG_PX = 6;

interface ShotBarProps {
  session: Session;
  film: Film;
  /** The shown shot. */
  store: Store;
  cuts: Cuts;
  player: FilmPlayer;
  playback: Playback;
}

export function ShotBar({ session, film, store, cuts, player, playback }: ShotBarProps) {
  const { sending, add } = useClips(session, store);
  const { shots } = session.document.value;
  const names = shots.map(({ id }) => edits.titleOf(session.document.value, id));
  return (
    <section
      class={`shot-bar ${shots.length > 1 ? "" : "single"}`}
      aria-label="Shot strip"
      ref={useDrops<HTMLElement>(add)}
    >
      <FilmBar player={player} film={film} store={store} playback={playback} />
      {shots.length > 1 && <ShotList session={session} film={film} names={names} />}
      <ShotActions session={session} store={store} cuts={cuts} />
      <label class="button small file-button">
        <Icon name="plus" />
        {sending === null ? "Add clips" : `Adding clips, ${percent(sending)}`}
        <input
          type="file"
          multiple
          accept={ACCEPT.video}
          aria-label="Add clips"
          disabled={sending !== null}
          onChange={({ currentTarget: input }) => {
            add([...(input.files ?? [])]);
            input.value = "";
          }}
        />
      </label>
    </section>
  );
}

/** Upload clips, and put them after the shown shot; `sending`: the share that is uploaded, null: nothing is. */
function useClips(session: Session, store: Store) {
  const [sending, setSending] = useState<number | null>(null);
  const add = async (files: readonly File[]) => {
    if (!files.length || sending !== null) return;
    setSending(0);
    const after = session.shotId.peek();
    const { method } = store.layer.peek();
    const clips: Asset[] = [];
    try {
      for (const [i, file] of files.entries())
        clips.push(await upload(file, { onProgress: (sent) => setSending((i + sent) / files.length) }));
    } catch (error) {
      notify(error);
    }
    const given = clips.map(({ id, filename }) => ({ id, title: filename }));
    session.edit("Add clips", (document) => edits.addClips(document, given, method, after));
    setSending(null);
  };
  return { sending, add };
}

function ShotList({ session, film, names }: { session: Session; film: Film; names: readonly string[] }) {
  const list = useRef<HTMLDivElement>(null);
  const [drag, setDrag] = useState<{ id: string; to: number } | null>(null);
  const { shots } = session.document.value;
  const shown = shots.findIndex(({ id }) => id === session.shotId.value);
  const start = useRef({ x: 0, id: "" });

  /** The place, from 0, that the dragged shot would get at a position on the screen. */
  const placeAt = (x: number, id: string): number =>
    [...(list.current?.children ?? [])]
      .filter((_, i) => shots[i]?.id !== id)
      .filter((card) => {
        const box = card.getBoundingClientRect();
        return box.left + box.width / 2 < x;
      }).length;

  const move = (id: string, to: number) => {
    session.edit("Move a shot", (document) => edits.moveShot(document, id, to));
    const at = session.document.peek().shots.findIndex((shot) => shot.id === id);
    announce(`${edits.titleOf(session.document.peek(), id)} is number ${at + 1} of ${shots.length}.`);
  };

  const onKey = (event: KeyboardEvent) => {
    const shot = shots[shown];
    const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (by && shot && event.shiftKey) move(shot.id, shown + by);
    else if (by) session.step(by);
    else if (event.key === "Home" || event.key === "End")
      session.step(event.key === "Home" ? -shown : shots.length - 1 - shown);
    else if (event.key === "Delete" && shot) remove(session, shot.id);
    else return;
    event.preventDefault();
    event.stopPropagation();
  };
  useEffect(() => {
    const show = () => list.current?.children[shown]?.scrollIntoView({ block: "nearest", inline: "nearest" });
    const observer = new ResizeObserver(show); // also when other controls take its room
    if (list.current) observer.observe(list.current);
    return () => observer.disconnect();
  }, [shown]);
  return (
    <div
      class="shot-list"
      ref={list}
      role="listbox"
      tabIndex={0}
      aria-label="Shots"
      aria-orientation="horizontal"
      aria-activedescendant={`shot-${shots[shown]?.id}`}
      aria-description="Left and right choose a shot; with Shift they move it. Delete removes it."
      onKeyDown={onKey}
    >
      {shots.map((shot, i) => (
        <div
          key={shot.id}
          id={`shot-${shot.id}`}
          class={`shot-card ${drag?.id === shot.id ? "dragged" : ""} ${drag && marks(drag, i, shots) ? `drop-${marks(drag, i, shots)}` : ""}`}
          role="option"
          tabIndex={-1}
          aria-selected={i === shown}
          onPointerDown={(event) => {
            if (event.button !== 0) return;
            start.current = { x: event.clientX, id: shot.id };
            event.currentTarget.setPointerCapture(event.pointerId);
          }}
          onPointerMove={(event) => {
            if (!event.currentTarget.hasPointerCapture(event.pointerId)) return;
            if (drag || Math.abs(event.clientX - start.current.x) > DRAG_PX)
              setDrag({ id: shot.id, to: placeAt(event.clientX, shot.id) });
          }}
          onPointerUp={() => {
            if (drag) move(drag.id, drag.to);
            session.shotId.value = shot.id;
            setDrag(null);
          }}
          onPointerCancel={() => setDrag(null)}
        >
          <Thumbnail session={session} shot={shot} />
          <span>
            {i + 1}. {names[i]}
          </span>
          {film.jobOf(shot.id)?.state === "succeeded" && <Painted />}
        </div>
      ))}
    </div>
  );
}

/** Whether the dragged shot would come before or after the card with this number. */
function marks(drag: { id: string; to: number }, index: number, shots: readonly Shot[]): "" | "before" | "after" {
  const others = shots.filter(({ id }) => id !== drag.id);
  const at = others.findIndex(({ id }) => id === shots[index]?.id);
  if (at < 0) return "";
  if (at === drag.to) return "before";
  return at === others.length - 1 && drag.to === others.length ? "after" : "";
}

function remove(session: Session, id: string): void {
  const name = edits.titleOf(session.document.peek(), id);
  if (session.document.peek().shots.length < 2) announce("A film has at least one shot.");
  else {
    session.edit("Remove a shot", (document) => edits.removeShot(document, id));
    announce(`${name} is removed. Ctrl+Z brings it back.`);
  }
}

/** The mark of a shot whose film shows what it shows now. */
const Painted = () => (
  <span class="shot-painted" title="Painted as it is now">
    <Icon name="check" />
    <span class="visually-hidden">, painted</span>
  </span>
);

/** The middle frame of a shot. */
function Thumbnail({ session, shot }: { session: Session; shot: Shot }) {
  const [src, setSrc] = useState("");
  const [length, setLength] = useState("");
  const range = shot.range?.join() ?? "";
  useEffect(() => {
    const life = new AbortController();
    const load = async () => {
      const clip = await session.clip(shot.id);
      const [first, end] = edits.framesOf(shot, clip.info.frames ?? 1);
      setLength(duration((end - first) / (clip.info.fps || 25)));
      const url = await thumbnail(clip.id, (first + end) >> 1, life.signal);
      if (life.signal.aborted) URL.revokeObjectURL(url);
      else setSrc(url);
    };
    load().catch((error) => console.info("Impasto: no picture of a shot.", error));
    return () => life.abort();
  }, [shot.video, range]);
  useEffect(() => () => URL.revokeObjectURL(src), [src]);
  return (
    <>
      {src ? <img src={src} alt="" draggable={false} /> : <span class="card-blank" />}
      {length && <small aria-hidden="true">{length}</small>}
    </>
  );
}

/** A component of its own: nothing but another name may replace what is being typed. */
const ShotName = ({ session, id }: { session: Session; id: string }) => (
  <input
    type="text"
    class="shot-name"
    maxLength={200}
    aria-label="Name of the shot"
    value={edits.titleOf(session.document.value, id)}
    onChange={({ currentTarget: { value } }) =>
      session.edit("Rename the shot", (document) => edits.renameShot(document, id, value.trim()))
    }
  />
);

/** What can be done with the shown shot. */
function ShotActions({ session, store, cuts }: Pick<ShotBarProps, "session" | "store" | "cuts">) {
  const id = session.shotId.value;
  const many = session.document.value.shots.length > 1;
  const frame = store.frame.value;
  const [first, end] = edits.framesOf(store.shot.value, store.frames);
  const found = store.cuts.value.filter((at) => first < at && at < end);
  const cut = (at: readonly number[], label: string) =>
    session.edit(label, (document) => edits.cutShot(document, store.shotId, at, store.frames));
  return (
    <div class="shot-actions" role="group" aria-label="The shot">
      <ShotName key={id} session={session} id={id} />
      <IconButton
        name="copy"
        label="Duplicate the shot"
        onClick={() => session.edit("Duplicate the shot", (document) => edits.duplicateShot(document, id))}
      />
      <IconButton
        name="cut"
        label="Cut the shot at this frame"
        disabled={frame <= first || frame >= end}
        onClick={() => cut([frame], "Cut the shot")}
      />
      <IconButton name="trash" label="Remove the shot" disabled={!many} onClick={() => remove(session, id)} />
      {found.length > 0 && (
        <button type="button" class="button small" onClick={() => cut(found, "Cut the shot at its cuts")}>
          Make {found.length + 1} shots at the cuts
        </button>
      )}
      {!found.length && cuts.done.value !== null && <span class="hint">Looking for cuts…</span>}
    </div>
  );
}

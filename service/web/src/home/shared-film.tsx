/** The film of a shared project: all shots in one file, its shots as chapters, and comments on its frames. */

import { useEffect, useRef, useState } from "preact/hooks";
import * as api from "../api/api";
import { under } from "../api/base";
import { joined } from "../api/joined";
import type { Page, Schemas } from "../api/schemas";
import { clock, percent } from "../ui/format";
import { notify } from "../ui/notices";

export type SharedFilm = Schemas["SharedFilmOut"];
type Comment = Schemas["Comment"];
type Chapter = Schemas["Chapter"];

/** Rounding errors of times are smaller than this, seconds. */
const ROUNDING_S = 1e-3;
const NAME = "impasto.comment-name";
/** How often comments of others are asked for. */
const EVERY_MS = 60_000;

/** The chapter and the frame of its clip that are shown at a second of the film. */
export function frameAtSecond(
  chapters: readonly Chapter[],
  second: number,
): { chapter: Chapter; frame: number } | null {
  const chapter = chapters.findLast(({ start_s }) => start_s <= second + ROUNDING_S) ?? chapters[0];
  if (!chapter) return null;
  const passed = Math.floor((second - chapter.start_s + ROUNDING_S) * chapter.fps);
  return { chapter, frame: chapter.first + Math.min(chapter.frames - 1, Math.max(0, passed)) };
}

/** The second of the film in the middle of a frame; undefined: the film does not have it. */
export function secondOfFrame(chapters: readonly Chapter[], shot: string, frame: number): number | undefined {
  const chapter = chapters.find((one) => one.shot === shot);
  const passed = chapter ? frame - chapter.first : -1;
  if (!chapter || passed < 0 || passed >= chapter.frames) return undefined;
  return chapter.start_s + (passed + 0.5) / (chapter.fps || 25);
}

export function WholeSharedFilm({ at, film, name }: { at: string; film: SharedFilm; name: string }) {
  const video = useRef<HTMLVideoElement>(null);
  const [second, setSecond] = useState(0);
  const [waiting, setWaiting] = useState<number | null>(null);
  const [src, setSrc] = useState("");
  const path = `${at}/film/content`;
  useEffect(() => {
    const life = new AbortController();
    joined(`${at}/film`, path, setWaiting, life.signal)
      .then(() => {
        setSrc(under(path));
        setWaiting(null);
      })
      .catch((error) => api.isAbort(error) || notify(error));
    return () => life.abort();
  }, [path]);
  const go = (to: number) => {
    if (video.current) video.current.currentTime = to;
    setSecond(to);
  };
  const place = frameAtSecond(film.chapters, second);
  return (
    <section class="shared-film" aria-label="The film">
      {waiting !== null && <p role="status">{`The shots are being joined: ${percent(waiting)}`}</p>}
      <video
        ref={video}
        {...(src && { src })}
        controls
        playsInline
        preload="metadata"
        aria-label={name}
        onTimeUpdate={({ currentTarget }) => setSecond(currentTarget.currentTime)}
        onSeeking={({ currentTarget }) => setSecond(currentTarget.currentTime)}
      />
      {film.chapters.length > 1 && (
        <ol class="chapters" aria-label="Shots">
          {film.chapters.map((chapter) => (
            <li key={chapter.shot}>
              <button
                type="button"
                class="button small"
                aria-current={chapter === place?.chapter ? "true" : undefined}
                onClick={() => go(chapter.start_s + 0.5 / (chapter.fps || 25))}
              >
                {chapter.name} <small>{clock(chapter.start_s)}</small>
              </button>
            </li>
          ))}
        </ol>
      )}
      {film.comments && place && <SharedComments at={at} film={film} place={place} go={go} video={video} />}
    </section>
  );
}

interface SharedCommentsProps {
  at: string;
  film: SharedFilm;
  place: { chapter: Chapter; frame: number };
  video: { current: HTMLVideoElement | null };
  go(second: number): void;
}

function SharedComments({ at, film, place, video, go }: SharedCommentsProps) {
  const [comments, setComments] = useState<readonly Comment[]>([]);
  const [text, setText] = useState("");
  const [author, setAuthor] = useState(localStorage.getItem(NAME) ?? "");
  const path = `${at}/comments`;
  useEffect(() => {
    const load = () => api.get<Page<Comment>>(path).then(({ items }) => setComments(items));
    load().catch(notify);
    const again = () => document.visibilityState === "visible" && load().catch(() => {}); // the next minute tries again
    const timer = setInterval(again, EVERY_MS);
    return () => clearInterval(timer);
  }, [path]);
  const { chapter, frame } = place;
  const send = async (event: Event) => {
    event.preventDefault();
    if (!text.trim()) return;
    localStorage.setItem(NAME, author);
    const body = { shot: chapter.shot, frame, text, author };
    const made: Comment = await (await api.post(path, body)).json();
    setComments((known) => [...known, made]);
    setText("");
  };
  return (
    <section class="shared-comments">
      <h2>Comments</h2>
      <ol>
        {comments.map((comment) => (
          <Written key={comment.id} comment={comment} chapters={film.chapters} go={go} />
        ))}
      </ol>
      <form onSubmit={(event) => send(event).catch(notify)}>
        <label>
          {`On ${chapter.name}, frame ${frame + 1}`}
          <input
            type="text"
            required
            maxLength={1000}
            value={text}
            onFocus={() => video.current?.pause()}
            onInput={({ currentTarget }) => setText(currentTarget.value)}
          />
        </label>
        <label>
          Your name
          <input
            type="text"
            maxLength={60}
            value={author}
            onInput={({ currentTarget }) => setAuthor(currentTarget.value)}
          />
        </label>
        <button type="submit" class="button primary">
          Comment
        </button>
      </form>
    </section>
  );
}

function Written({ comment, chapters, go }: { comment: Comment; chapters: readonly Chapter[]; go(to: number): void }) {
  const second = secondOfFrame(chapters, comment.shot, comment.frame);
  const chapter = chapters.find(({ shot }) => shot === comment.shot);
  const place = chapter ? `${chapter.name}, frame ${comment.frame + 1}` : "A shot that the film does not have now";
  return (
    <li class="comment">
      <span>
        <strong>{comment.author || (comment.by_link ? "Somebody" : "The owner")}</strong> {comment.text}
      </span>
      <button type="button" class="button small" disabled={second === undefined} onClick={() => go(second ?? 0)}>
        {place}
      </button>
    </li>
  );
}

/** Comments on frames: marks below the filmstrip, the comments at the shown frame, and a field to write one. */

import { signal } from "@preact/signals";
import { useEffect, useRef, useState } from "preact/hooks";
import { isAbort } from "../../api/api";
import { ago } from "../../ui/format";
import { Icon, IconButton } from "../../ui/icons";
import { announce, notify } from "../../ui/notices";
import { addComment, type Comment, deleteComment, listComments } from "../document/api";
import type { Store } from "../state/store";
import { isShown, shareOf } from "../state/timeline";

const EVERY_MS = 60_000;

/** Comments of an open project; those that others write come within a minute. */
export class Comments {
  readonly all = signal<readonly Comment[]>([]);
  /** Whether the field for a comment on the shown frame is open. */
  readonly writing = signal(false);
  private readonly timer: number;

  constructor(private readonly project: string) {
    this.load();
    this.timer = window.setInterval(() => document.visibilityState === "visible" && this.load(), EVERY_MS);
  }

  private load(): void {
    const before = this.all.peek();
    listComments(this.project).then(
      (found) => {
        if (this.all.peek() === before) this.all.value = found;
      },
      (error) => isAbort(error) || console.info("Impasto: no comments.", error),
    );
  }

  async add(shot: string, frame: number, text: string): Promise<void> {
    const made = await addComment(this.project, { shot, frame, text, author: "" });
    this.all.value = [...this.all.peek(), made];
  }

  async remove({ id }: Comment): Promise<void> {
    await deleteComment(this.project, id);
    this.all.value = this.all.peek().filter((one) => one.id !== id);
    announce("The comment is deleted.");
  }

  close(): void {
    clearInterval(this.timer);
  }
}

/** "Mia", "You", "Somebody with a link". */
export const writerOf = ({ author, by_link }: Comment): string =>
  author || (by_link ? "Somebody with a link" : "The owner");

export function CommentLane({ store, comments }: { store: Store; comments: Comments }) {
  const own = comments.all.value.filter(({ shot }) => shot === store.shotId);
  const frame = store.frame.value;
  const span = store.span.value;
  const present = own.filter((comment) => comment.frame === frame);
  const frames = [...new Set(own.map((comment) => comment.frame))].filter((at) => isShown(at, span));
  if (!own.length && !comments.writing.value) return null;
  return (
    <div class="comments" role="group" aria-label="Comments">
      <div class="marker-lane">
        {frames.map((at) => {
          const here = own.filter((comment) => comment.frame === at);
          const label = `Comment at frame ${at + 1}: ${here[0]?.text ?? ""}${here.length > 1 ? `, and ${here.length - 1} more` : ""}`;
          return (
            <button
              key={at}
              type="button"
              class="marker comment-mark"
              aria-label={label}
              title={label}
              aria-current={at === frame ? "true" : undefined}
              style={{ left: `${100 * shareOf(at + 0.5, span)}%` }}
              onClick={() => store.goTo(at)}
            >
              <Icon name="comment" />
            </button>
          );
        })}
      </div>
      {present.map((comment) => (
        <p key={comment.id} class="comment">
          <span>
            <strong>{writerOf(comment)}</strong> {comment.text} <small>{ago(comment.at)}</small>
          </span>
          <IconButton name="trash" label="Delete the comment" onClick={() => comments.remove(comment).catch(notify)} />
        </p>
      ))}
      {comments.writing.value && <Draft store={store} comments={comments} />}
    </div>
  );
}

function Draft({ store, comments }: { store: Store; comments: Comments }) {
  const [text, setText] = useState("");
  const field = useRef<HTMLInputElement>(null);
  useEffect(() => field.current?.focus(), []);
  const send = async (event: Event) => {
    event.preventDefault();
    if (!text.trim()) return;
    await comments.add(store.shotId, store.frame.peek(), text.trim());
    setText("");
    comments.writing.value = false;
  };
  return (
    <form class="marker-note" onSubmit={(event) => send(event).catch(notify)}>
      <input
        type="text"
        maxLength={1000}
        value={text}
        ref={field}
        placeholder="Comment, which people with a link that allows comments read"
        aria-label={`Comment on frame ${store.frame.value + 1}`}
        onInput={({ currentTarget }) => setText(currentTarget.value)}
      />
      <button type="submit" class="button small">
        Send
      </button>
    </form>
  );
}

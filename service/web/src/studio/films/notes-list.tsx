/** All comments and markers of the film in one list; a choice shows the frame. */

import { useRef } from "preact/hooks";
import { ago } from "../../ui/format";
import { IconButton } from "../../ui/icons";
import { titleOf } from "../document/shots";
import type { Session } from "../state/session";
import { type Comments, writerOf } from "./comments";
import { markersOf } from "./markers";

/** What somebody wrote about a frame; `who` is empty for a marker of the project. */
interface Note {
  shot: string;
  frame: number;
  who: string;
  text: string;
  when: string;
}

function notesOf(session: Session, comments: Comments): Note[] {
  const { shots } = session.document.value;
  return shots.flatMap((shot) => {
    const written = comments.all.value.filter((comment) => comment.shot === shot.id);
    const said = written.map((one) => ({ ...one, who: writerOf(one), when: ago(one.at) }));
    const marked = markersOf(shot).map(({ frame, note }) => ({
      ...{ shot: shot.id, frame },
      ...{ who: "", text: note || "Marker", when: "" },
    }));
    return [...said, ...marked].sort((a, b) => a.frame - b.frame);
  });
}

export function NotesList({ session, comments }: { session: Session; comments: Comments }) {
  const dialog = useRef<HTMLDialogElement>(null);
  const notes = notesOf(session, comments);
  if (!notes.length) return null;
  const show = ({ shot, frame }: Note) => {
    dialog.current?.close();
    session.show(shot, frame);
  };
  return (
    <>
      <IconButton
        name="comment"
        label={`Comments and markers of the film: ${notes.length}`}
        onClick={() => dialog.current?.showModal()}
      />
      <dialog ref={dialog} class="project-menu notes-list" aria-labelledby="notes-list-title">
        <h2 id="notes-list-title">Comments and markers</h2>
        <ol>
          {notes.map((note, i) => (
            <li key={`${note.shot}-${note.frame}-${i}`}>
              <button type="button" onClick={() => show(note)}>
                <small>{`${titleOf(session.document.value, note.shot)}, frame ${note.frame + 1}`}</small>
                <span>
                  {note.who && <strong>{note.who}</strong>} {note.text}
                </span>
                <small>{note.when}</small>
              </button>
            </li>
          ))}
        </ol>
        <form method="dialog">
          <button type="submit" class="button primary">
            Close
          </button>
        </form>
      </dialog>
    </>
  );
}

/** The film over the stage while it plays, or while the pointer drags along it. */

import { useEffect, useRef } from "preact/hooks";
import { titleOf } from "../document/shots";
import type { Session } from "../state/session";
import type { FilmPlayer, Shown } from "./film-player";

export function FilmScreen({ player, session }: { player: FilmPlayer; session: Session }) {
  return player.open.value ? <Screen player={player} session={session} /> : null;
}

function Screen({ player, session }: { player: FilmPlayer; session: Session }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    player.show(canvas.current);
    return () => player.show(null);
  }, []);
  return (
    <div class="film-screen" onPointerDown={() => player.playing.peek() && player.stop()}>
      <canvas ref={canvas} role="img" aria-label="The film" />
      <p role="status">{player.shown.value && shownText(player, session, player.shown.value)}</p>
    </div>
  );
}

/** "Shot 2 of 6, The bar: painted." */
function shownText(player: FilmPlayer, session: Session, { number, painted }: Shown): string {
  const film = player.pieces.value;
  const name = titleOf(session.document.value, film[number]?.shot ?? "");
  const shot = `Shot ${number + 1} of ${film.length}${name === `Shot ${number + 1}` ? "" : `, ${name}`}`;
  if (player.originals) return `${shot}: the original video`;
  return `${shot}: ${painted ? "painted" : "not painted as it is now, this is its video"}`;
}

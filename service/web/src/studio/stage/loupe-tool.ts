/** The loupe: a piece of the frame under the pointer, painted at full size while the stage shows a smaller preview. */

import { asProblem, isAbort } from "../../api/api";
import { pictureOf, preview } from "../document/api";
import { type Point, type ProjectDocument, shownAlone } from "../document/document";
import type { Store } from "../state/store";
import type { StageTool } from "../state/tool";

const SIZE: Point = [320, 220];
const REST_MS = 200;

/** A piece of a frame at full size. */
interface Piece {
  frame: number;
  document: ProjectDocument;
  /** Left, top, width and height in px of the video. */
  box: [number, number, number, number];
  picture: ImageBitmap;
}

/** The box of at most `SIZE` px around a point, within the picture. */
function boxAround([x, y]: Point, { width, height }: { width: number; height: number }): Piece["box"] {
  const [w, h] = [Math.min(SIZE[0], width), Math.min(SIZE[1], height)];
  const left = Math.min(width - w, Math.max(0, Math.round(x - w / 2)));
  const top = Math.min(height - h, Math.max(0, Math.round(y - h / 2)));
  return [left, top, w, h];
}

export function createLoupeTool(store: Store, redraw: () => void): StageTool {
  let piece: Piece | null = null;
  let at: Point | null = null;
  let timer = 0;
  let running = new AbortController();

  async function load(point: Point): Promise<void> {
    running.abort();
    running = new AbortController();
    const { signal } = running;
    const [frame, document, box] = [store.frame.value, store.document.value, boxAround(point, store.size)];
    const layer = shownAlone(store.shot.value, store.layerId.value);
    let doing = "Painting this piece at full size";
    store.busy.value = `${doing}…`;
    try {
      await preview({
        project: store.projectId,
        what: "paint",
        channel: "loupe",
        body: { document, shot: store.shot.value.id, layer, frame, crop: box },
        signal,
        async onrecord(record) {
          const { header } = record;
          if (header.type === "progress") store.busy.value = `${doing}: ${Math.round(100 * header.done)} %`;
          if (header.type !== "frame") return;
          doing = header.final ? "" : "The loupe shows a draft of this frame alone; painting it as in the film";
          store.busy.value = doing;
          const picture = await pictureOf(record);
          if (signal.aborted) return;
          piece = { frame, document, box, picture };
          redraw();
        },
      });
    } catch (error) {
      if (!isAbort(error) && !signal.aborted) store.problem.value = asProblem(error).message;
    } finally {
      if (!signal.aborted) store.busy.value = "";
    }
  }

  function moveTo(point: Point): void {
    at = point;
    clearTimeout(timer);
    timer = window.setTimeout(() => load(point), REST_MS);
    redraw();
  }

  return {
    cursor: "zoom-in",
    down(sample) {
      moveTo(sample.at);
      return true;
    },
    move(samples) {
      const last = samples.at(-1);
      if (last) moveTo(last.at);
    },
    up() {},
    hover(sample) {
      if (sample) moveTo(sample.at);
      else {
        clearTimeout(timer);
        running.abort();
        at = null;
        store.busy.value = "";
        redraw();
      }
    },
    draw(context, px) {
      const { canvas } = context;
      delete canvas.dataset.loupe;
      if (!at || piece?.frame !== store.frame.value || piece.document !== store.document.value) return;
      if (piece.box.join() !== boxAround(at, store.size).join()) return; // of where the pointer was before
      const [, , width, height] = piece.box;
      const [w, h] = [width * px, height * px]; // one pixel of the video is one of the page
      const [left, top] = [at[0] - w / 2, at[1] - h / 2];
      context.drawImage(piece.picture, left, top, w, h);
      context.lineWidth = 2 * px;
      context.strokeStyle = "#fff";
      context.strokeRect(left, top, w, h);
      canvas.dataset.loupe = piece.box.join(" ");
    },
  };
}

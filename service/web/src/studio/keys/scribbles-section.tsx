/** Scribbles that mark the foreground of a patches layer, in any frame. */

import { useEffect, useRef } from "preact/hooks";
import { Icon, IconButton } from "../../ui/icons";
import { keyFrames, thumbnail } from "../films/filmstrip";
import type { Store } from "../state/store";
import type { Foreground, Veil } from "./foreground";
import type { PaintedKeys } from "./keys";

const FOREGROUND = "#ffffff";
const BACKGROUND = "#000000";

interface ScribblesProps {
  store: Store;
  keys: PaintedKeys;
  foreground: Foreground;
}

export function ScribblesSection({ store, keys, foreground }: ScribblesProps) {
  const frame = store.frame.value;
  const here = keyFrames(store).includes(frame);
  const scribble = (color: string) => () => {
    store.brush.value = { color, size: Math.max(4, Math.round(store.size.height / 40)), opacity: 1 };
    store.tool.value = "brush";
  };
  return (
    <section class="side-section" aria-labelledby="scribbles-title">
      <h2 id="scribbles-title">Foreground</h2>
      <p class="hint">Scribble over the foreground and over the background: the rest of the shot follows.</p>
      <div class="actions">
        <button type="button" class="button" onClick={scribble(FOREGROUND)}>
          <Icon name="brush" />
          Mark the foreground
        </button>
        <button type="button" class="button" onClick={scribble(BACKGROUND)}>
          <Icon name="brush" />
          Mark the background
        </button>
        {here && (
          <IconButton name="trash" label="Remove the scribbles of this frame" onClick={() => keys.remove(frame)} />
        )}
      </div>
      {(store.layer.value.scribbles ?? []).length > 0 && store.previews.value && (
        <Spread store={store} foreground={foreground} />
      )}
    </section>
  );
}

/** The foreground of the shown frame and of those after it. */
function Spread({ store, foreground }: { store: Store; foreground: Foreground }) {
  const veils = [...foreground.veils.value].sort(([a], [b]) => a - b);
  const from = Math.max(
    0,
    veils.findIndex(([frame]) => frame >= store.frame.value),
  );
  return (
    <>
      <label class="check-field">
        <input
          type="checkbox"
          checked={foreground.shown.value}
          onChange={(event) => {
            foreground.shown.value = event.currentTarget.checked;
          }}
        />
        Show the foreground
      </label>
      {veils.length > 0 && (
        <div class="neighbours" role="group" aria-label="Foreground of the next frames">
          {veils.slice(from, from + 8).map(([frame, veil]) => (
            <button key={frame} type="button" aria-label={`Frame ${frame + 1}`} onClick={() => store.goTo(frame)}>
              <VeiledFrame assetId={store.asset.id} frame={frame} veil={veil} />
              <span>{frame + 1}</span>
            </button>
          ))}
        </div>
      )}
    </>
  );
}

function VeiledFrame({ assetId, frame, veil }: { assetId: string; frame: number; veil: Veil }) {
  const canvas = useRef<HTMLCanvasElement>(null);
  useEffect(() => {
    const controller = new AbortController();
    const show = async () => {
      const url = await thumbnail(assetId, frame, controller.signal);
      const element = canvas.current;
      if (!url || !element) return;
      const picture = new Image();
      picture.src = url;
      await picture.decode();
      URL.revokeObjectURL(url);
      Object.assign(element, { width: picture.width, height: picture.height });
      const context = element.getContext("2d");
      context?.drawImage(picture, 0, 0);
      context?.drawImage(veil, 0, 0, picture.width, picture.height);
    };
    show().catch(() => {});
    return () => controller.abort();
  }, [assetId, frame, veil]);
  return <canvas ref={canvas} />;
}

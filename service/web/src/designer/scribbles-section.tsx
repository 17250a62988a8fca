/** Scribbles that mark the foreground of a patches layer, in any frame. */

import { keyFrames } from "./filmstrip";
import { Icon, IconButton } from "./icon";
import type { PaintedKeys } from "./keys";
import type { Store } from "./store";

const FOREGROUND = "#ffffff";
const BACKGROUND = "#000000";

export function ScribblesSection({ store, keys }: { store: Store; keys: PaintedKeys }) {
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
    </section>
  );
}

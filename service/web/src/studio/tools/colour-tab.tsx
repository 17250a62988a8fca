/** Colours: wheel, recent ones, swatches, and a palette that is taken from the painting. */

import { useState } from "preact/hooks";
import { isAbort } from "../../api/http";
import { Icon } from "../../ui/icons";
import { notify } from "../../ui/notices";
import { mainColours } from "../../ui/palette";
import { createCanvas } from "../drawing/canvas";
import type { PaintedKeys } from "../keys/keys";
import type { Store } from "../state/store";
import { ColourWheel } from "./colour-wheel";

const PALETTE = 12;
/** Longest side of the picture from which colours are taken, px. */
const SIDE_PX = 320;

export function ColourTab({ store, keys }: { store: Store; keys: PaintedKeys }) {
  const { recent, swatches, background } = store.drawing;
  const { color } = store.brush.value;
  const [palette, setPalette] = useState<readonly string[]>([]);
  const choose = (chosen: string) => {
    store.brush.value = { ...store.brush.peek(), color: chosen };
  };
  const takePalette = () => {
    coloursOfKey(store, keys).then(setPalette, (error) => isAbort(error) || notify(error));
  };
  return (
    <>
      <ColourWheel color={color} onChange={choose} />
      <div class="actions">
        <button type="button" class="button small" onClick={() => store.swapColours()}>
          <Icon name="swap" />
          Swap with <span class="swatch" style={{ background: background.value }} />
        </button>
        <button
          type="button"
          class="button small"
          disabled={swatches.value.includes(color)}
          onClick={() => {
            swatches.value = [...swatches.value, color];
          }}
        >
          <Icon name="plus" />
          Swatch
        </button>
      </div>
      <Swatches title="Recent colours" colours={recent.value} chosen={color} choose={choose} />
      <Swatches
        title="Swatches"
        colours={swatches.value}
        chosen={color}
        choose={choose}
        remove={(gone) => {
          swatches.value = swatches.value.filter((one) => one !== gone);
        }}
      />
      <Swatches title="Colours of the painting" colours={palette} chosen={color} choose={choose} />
      <button type="button" class="button small" onClick={takePalette}>
        <Icon name="picker" />
        Take the colours of this frame
      </button>
    </>
  );
}

/** The main colours of the key, or of the frame that would be painted on. */
async function coloursOfKey(store: Store, keys: PaintedKeys): Promise<string[]> {
  const frame = store.frame.peek();
  const picture = await createImageBitmap(await keys.small(frame, await keys.open(frame), SIDE_PX));
  const [, context] = createCanvas(picture);
  context.drawImage(picture, 0, 0);
  return mainColours(context.getImageData(0, 0, picture.width, picture.height).data, PALETTE);
}

interface SwatchesProps {
  title: string;
  colours: readonly string[];
  chosen: string;
  choose(color: string): void;
  /** With Delete, or by a click with Alt. */
  remove?(color: string): void;
}

function Swatches({ title, colours, chosen, choose, remove }: SwatchesProps) {
  if (!colours.length) return null;
  return (
    <section class="swatches">
      <h2>{title}</h2>
      <div role="group" aria-label={title}>
        {colours.map((colour) => (
          <button
            key={colour}
            type="button"
            class="swatch"
            style={{ background: colour }}
            aria-label={colour}
            aria-pressed={colour === chosen}
            title={remove ? `${colour}; Alt-click removes it` : colour}
            onClick={(event) => (remove && event.altKey ? remove(colour) : choose(colour))}
            onKeyDown={(event) => event.key === "Delete" && remove?.(colour)}
          />
        ))}
      </div>
    </section>
  );
}

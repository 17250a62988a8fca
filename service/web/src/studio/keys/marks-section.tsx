/** Marks on any frames, in the colours of the section, and what the service makes of them. */

import { useEffect, useRef } from "preact/hooks";
import type { Section } from "../../api/schemas";
import { Icon, IconButton } from "../../ui/icons";
import { picturesOf } from "../document/document";
import { thumbnail } from "../films/filmstrip";
import { paintedFrames } from "../films/key-marks";
import type { Store } from "../state/store";
import type { Foreground, Veil } from "./foreground";
import type { PaintedKeys } from "./keys";

interface MarksProps {
  store: Store;
  section: Section;
  keys: PaintedKeys;
  foreground: Foreground;
}

export function MarksSection({ store, section, keys, foreground }: MarksProps) {
  const frame = store.frame.value;
  const here = paintedFrames(store, [section]).includes(frame);
  const { overlay } = section;
  const marked = overlay?.after.some((part) => picturesOf(store.layer.value, part).length > 0);
  const mark = (color: string) => {
    store.brush.value = {
      ...store.brush.value,
      color,
      size: Math.max(4, Math.round(store.size.height / 40)),
      opacity: 1,
    };
    store.tool.value = "brush";
  };
  return (
    <section class="side-section" onClickCapture={() => store.paint(section)} aria-labelledby={`${section.part}-title`}>
      <h2 id={`${section.part}-title`}>{section.title}</h2>
      {section.hint && <p class="hint">{section.hint}</p>}
      <div class="actions">
        {section.marks.map(({ title, colour }) => (
          <button key={colour} type="button" class="button" onClick={() => mark(colour)}>
            <Icon name="brush" />
            Mark the {title.toLowerCase()}
          </button>
        ))}
        {here && (
          <IconButton name="trash" label="Remove the marks of this frame" onClick={() => keys.remove(frame, section)} />
        )}
      </div>
      {overlay && overlay.kind !== "labels" && marked && store.previews.value && (
        <Spread store={store} name={section.title} title={overlay.title} foreground={foreground} />
      )}
    </section>
  );
}

interface SpreadProps {
  store: Store;
  name: string;
  /** Of the switch. */
  title: string;
  foreground: Foreground;
}

/** What the marks make of the shown frame and of those after it. */
function Spread({ store, name, title, foreground }: SpreadProps) {
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
        {title}
      </label>
      {veils.length > 0 && (
        <div class="neighbours" role="group" aria-label={`${name} of the next frames`}>
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

/** The drawing panel over the stage: brushes and their settings, colours, and a reference. */

import { useEffect } from "preact/hooks";
import { IconButton } from "../../ui/icons";
import { PANEL_TABS, type PanelTab } from "../drawing/settings";
import type { PaintedKeys } from "../keys/keys";
import { PAINT_TOOLS, type Store } from "../state/store";
import { BrushList } from "./brush-list";
import { ColourTab } from "./colour-tab";
import { ReferenceTab } from "./reference-tab";

const TITLES: Record<PanelTab, string> = { brush: "Brushes", colour: "Colours", reference: "Reference" };

export function DrawingPanel({ store, keys }: { store: Store; keys: PaintedKeys }) {
  const { panel } = store.drawing;
  const tab = panel.value;
  const painting = PAINT_TOOLS.includes(store.tool.value);
  if (!tab || !painting) return null;
  return (
    <aside class="drawing-panel" aria-label="Drawing">
      <header>
        <div class="views" role="tablist" aria-label="Drawing" onKeyDown={(event) => step(event, tab, store)}>
          {PANEL_TABS.map((one) => (
            <button
              key={one}
              type="button"
              role="tab"
              id={`drawing-${one}`}
              aria-selected={one === tab}
              aria-controls="drawing-tab"
              tabIndex={one === tab ? 0 : -1}
              onClick={() => {
                panel.value = one;
              }}
            >
              {TITLES[one]}
            </button>
          ))}
        </div>
        <IconButton
          name="close"
          label="Close the drawing panel"
          onClick={() => {
            panel.value = "";
          }}
        />
      </header>
      <div id="drawing-tab" class="drawing-tab" role="tabpanel" aria-labelledby={`drawing-${tab}`}>
        <Tab store={store} keys={keys} tab={tab} />
      </div>
    </aside>
  );
}

function Tab({ store, keys, tab }: { store: Store; keys: PaintedKeys; tab: PanelTab }) {
  useEffect(() => {
    document.querySelector(".drawing-tab")?.scrollTo(0, 0);
  }, [tab]);
  if (tab === "brush") return <BrushList store={store} />;
  return tab === "colour" ? <ColourTab store={store} keys={keys} /> : <ReferenceTab store={store} keys={keys} />;
}

function step(event: KeyboardEvent, tab: PanelTab, store: Store): void {
  const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (!by) return;
  const next = PANEL_TABS[(PANEL_TABS.indexOf(tab) + by + PANEL_TABS.length) % PANEL_TABS.length] ?? tab;
  store.drawing.panel.value = next;
  document.getElementById(`drawing-${next}`)?.focus();
}

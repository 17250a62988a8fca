/** How somebody draws: brushes, colours, fill, and what the stage shows meanwhile. Own brushes and colours stay in this browser. */

import { effect, type Signal, signal } from "@preact/signals";
import { type BrushPreset, PLAIN } from "./brushes";

/** What the stage shows with a painting tool: the key, the key beside or over the video's frame, or that frame. */
export type PaintView = "key" | "compare" | "overlay" | "source";

export interface FillSettings {
  /** Largest difference of a channel, 0..128. */
  tolerance: number;
  /** Gaps up to this many px are closed. */
  gap: number;
  /** Whether the area is looked for in the layer alone, not in what all layers make. */
  layerOnly: boolean;
}

export interface OnionSkin {
  show: "none" | "painted" | "source";
  /** Frames on each side, 1..3. */
  frames: number;
}

export const PANEL_TABS = ["brush", "colour", "reference"] as const;
export type PanelTab = (typeof PANEL_TABS)[number];

const RECENT = 12;
const SWATCHES = ["#1d1a17", "#ffffff", "#7a4a2b", "#b43c25", "#dba033", "#5d7f3a", "#2f6f73", "#2f4d93", "#6b3f7c"];

/** A signal whose value is kept in this browser. */
function kept<T>(name: string, first: T): Signal<T> {
  const key = `impasto.${name}`;
  const value = signal(stored(key, first));
  effect(() => {
    const text = JSON.stringify(value.value);
    try {
      if (value.value !== first) localStorage.setItem(key, text);
    } catch (error) {
      console.info(`Impasto: this browser has no room for ${name}.`, error);
    }
  });
  return value;
}

function stored<T>(key: string, first: T): T {
  try {
    return (JSON.parse(localStorage.getItem(key) ?? "null") as T | null) ?? first;
  } catch {
    return first;
  }
}

/** The tip of a tool that has no colour. */
export type ToolTip = Pick<BrushPreset, "name" | "tip">;

export class DrawingSettings {
  readonly eraser = signal<ToolTip>(PLAIN);
  readonly smudge = signal<ToolTip>(PLAIN);
  readonly background = signal("#ffffff");
  readonly recent = kept<readonly string[]>("colours-recent", []);
  readonly swatches = kept<readonly string[]>("swatches", SWATCHES);
  readonly ownBrushes = kept<readonly BrushPreset[]>("brushes", []);
  /** Length of the string on which the pen pulls the brush, CSS px. */
  readonly stabiliser = kept("stabiliser", 0);
  readonly fill = signal<FillSettings>({ tolerance: 24, gap: 0, layerOnly: false });
  readonly view = signal<PaintView>("key");
  readonly onion = signal<OnionSkin>({ show: "none", frames: 1 });
  /** The tab of the drawing panel; empty: it is closed. */
  readonly panel = signal<PanelTab | "">("");
  /** Whether the stage has the whole window. */
  readonly alone = signal(false);

  /** A colour was painted with. */
  used(color: string): void {
    const before = this.recent.peek();
    if (before[0] !== color) this.recent.value = [color, ...before.filter((one) => one !== color)].slice(0, RECENT);
  }
}

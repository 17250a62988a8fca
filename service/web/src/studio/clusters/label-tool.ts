/** Paints labels on the cluster map of the shown frame; with Alt, takes up the label under the pointer. */

import type { Store } from "../state/store";
import type { PointerSample, StageTool } from "../state/tool";
import type { Clusters } from "./clusters";
import { colourOf, stamped } from "./label-edits";

export function createLabelTool(store: Store, clusters: Clusters, redraw: () => void): StageTool {
  let path: [number, number][] = [];
  let at: PointerSample | null = null;

  const map = () => (clusters.map.value?.frame === store.frame.value ? clusters.map.value : null);

  function labelAt([x, y]: readonly [number, number]): number | undefined {
    const found = map();
    if (!found) return undefined;
    const column = Math.floor((x / store.size.width) * found.width);
    const row = Math.floor((y / store.size.height) * found.height);
    if (column < 0 || row < 0 || column >= found.width || row >= found.height) return undefined;
    return found.labels[row * found.width + column];
  }

  return {
    cursor: "crosshair",
    down(sample) {
      if (!map()) return false;
      const picked = sample.alt ? labelAt(sample.at) : undefined;
      if (picked !== undefined) clusters.label.value = picked;
      else if (!sample.alt) path = [[...sample.at]];
      redraw();
      return true;
    },
    move(samples) {
      if (path.length) path.push(...samples.map((sample): [number, number] => [...sample.at]));
      redraw();
    },
    up() {
      const found = map();
      if (path.length && found) {
        const scale = found.width / store.size.width;
        const scaled = path.map(([x, y]): [number, number] => [x * scale, y * scale]);
        const radius = (store.brush.value.size / 2) * scale;
        clusters.correct("Paint labels", found.frame, stamped(found, scaled, radius, clusters.label.value));
      }
      path = [];
      redraw();
    },
    cancel() {
      path = [];
      redraw();
    },
    hover(sample) {
      at = sample;
      redraw();
    },
    draw(context, px) {
      context.lineCap = context.lineJoin = "round";
      context.strokeStyle = `rgb(${colourOf(clusters.label.value).join(" ")})`;
      context.lineWidth = store.brush.value.size;
      context.beginPath();
      for (const [x, y] of path) context.lineTo(x, y);
      const [only] = path;
      if (only) context.lineTo(only[0] + 0.01, only[1]);
      context.stroke();
      if (!at || path.length) return;
      context.lineWidth = 1.5 * px;
      context.strokeStyle = "#fff";
      context.beginPath();
      context.arc(at.at[0], at.at[1], store.brush.value.size / 2, 0, 2 * Math.PI);
      context.stroke();
    },
  };
}

/** The tools beside the stage. */

import type { IconName } from "../../ui/icons";
import { IconButton } from "../../ui/icons";
import type { Clusters } from "../clusters/clusters";
import { regionsState } from "../regions/region-tool";
import type { Stage } from "../stage/stage";
import { keyText } from "../state/key-bindings";
import { MATTE_TOOLS, PAINT_TOOLS, SELECT_TOOLS, type Store, type Tool } from "../state/store";

const TOOLS: Record<Tool, { icon: IconName; label: string }> = {
  pan: { icon: "pan", label: "Move the view" },
  brush: { icon: "brush", label: "Brush" },
  eraser: { icon: "eraser", label: "Eraser" },
  smudge: { icon: "smudge", label: "Smudge" },
  fill: { icon: "fill", label: "Fill" },
  picker: { icon: "picker", label: "Pick a colour" },
  rectangle: { icon: "frame", label: "Select a rectangle" },
  outline: { icon: "lasso", label: "Select with an outline" },
  transform: { icon: "transform", label: "Move, scale, turn" },
  object: { icon: "object", label: "Mark an object" },
  matte: { icon: "matte", label: "Mark the layer's matte" },
  matteBrush: { icon: "matteBrush", label: "Add to the matte with a brush" },
  matteEraser: { icon: "matteEraser", label: "Erase the matte" },
  region: { icon: "select", label: "Pick regions" },
  lasso: { icon: "lasso", label: "Draw a region" },
  correct: { icon: "brush", label: "Correct the region" },
  direction: { icon: "arrow", label: "Direct the strokes" },
  label: { icon: "fill", label: "Paint cluster labels" },
  loupe: { icon: "eye", label: "Loupe at full size" },
};

/** Tools for the inputs of the layer's method. `regions`, `clusters`: whether the service can find or has found them. */
export function toolsOf(store: Store, regions: boolean, clusters: boolean): Tool[] {
  const { tools = [] } = store.method.value?.studio ?? {};
  const layers = store.painted()?.editor === "keys" ? SELECT_TOOLS : [];
  const all = [...tools, ...layers];
  return [
    "pan",
    ...all.filter(
      (tool) =>
        (tool !== "region" || regions) && (tool !== "object" || store.previews.value) && (tool !== "label" || clusters),
    ),
  ];
}

/** One step of turning the view. */
export const TURN_DEGREES = 15;

/** The stage alone in the whole screen, or the studio again. */
export function toggleAlone(store: Store): void {
  const { alone } = store.drawing;
  alone.value = !alone.value;
  if (alone.value)
    document.documentElement.requestFullscreen?.().catch(() => {}); // the window is enough
  else if (document.fullscreenElement) document.exitFullscreen();
}

interface ToolbarProps {
  store: Store;
  clusters: Clusters;
  stage: () => Stage | null;
}

export function Toolbar({ store, clusters, stage }: ToolbarProps) {
  const regions = store.previews.value && regionsState.value !== "missing";
  const chosen = toolsOf(store, regions, clusters.available.value);
  const matte = MATTE_TOOLS.includes(store.tool.value) ? MATTE_TOOLS : [];
  const tools: Tool[] = store.previews.value ? [...chosen, ...matte, "loupe"] : chosen;
  return (
    <div class="toolbar" role="toolbar" aria-label="Tools" aria-orientation="vertical">
      {tools.map((tool) => (
        <IconButton
          key={tool}
          name={TOOLS[tool].icon}
          label={TOOLS[tool].label}
          keys={keyText(tool)}
          pressed={store.tool.value === tool}
          onClick={() => {
            store.tool.value = tool;
            if (tool === "label") clusters.shown.value = true;
          }}
        />
      ))}
      <hr />
      <IconButton
        name="undo"
        label="Undo"
        keys="Ctrl+Z"
        disabled={!store.history.value.past.length}
        onClick={() => store.session.undo()}
      />
      <IconButton
        name="redo"
        label="Redo"
        keys="Ctrl+Shift+Z"
        disabled={!store.history.value.future.length}
        onClick={() => store.session.redo()}
      />
      <hr />
      <IconButton name="zoom" label="Zoom in" keys="+" onClick={() => stage()?.zoom(1.25)} />
      <IconButton name="full" label="Show the whole frame" keys="0" onClick={() => stage()?.fit()} />
      {PAINT_TOOLS.includes(store.tool.value) && (
        <>
          <IconButton
            name="turn"
            label="Turn the view"
            keys={`${keyText("turnLeft")} ${keyText("turnRight")}`}
            onClick={() => stage()?.turn(TURN_DEGREES)}
          />
          <IconButton
            name="mirror"
            label="Mirror the view"
            keys={keyText("mirror")}
            pressed={Boolean(store.view.value.mirrored)}
            onClick={() => stage()?.mirror()}
          />
          <IconButton
            name="screen"
            label="Draw in the whole window"
            keys={keyText("alone")}
            pressed={store.drawing.alone.value}
            onClick={() => toggleAlone(store)}
          />
        </>
      )}
    </div>
  );
}

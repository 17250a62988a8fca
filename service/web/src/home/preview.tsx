/** The stage of the quick page: one frame, original and painted, which follows the parameters as they change. */

import { useEffect, useRef, useState } from "preact/hooks";
import * as api from "../api/api";
import type { Asset, PreviewRequest } from "../api/schemas";
import { clock } from "../ui/format";
import { IconButton } from "../ui/icons";
import { Wipe } from "../ui/wipe";
import { Original } from "./original";

const DEBOUNCE_MS = 100;
const MAX_SIDE_PX = 720;
/** The service makes few previews at once: when it is busy, ask again. */
const BUSY_TRIES = 10;
const BUSY_MS = 1200;

export interface PreviewProps {
  asset: Asset;
  localUrl: string | undefined;
  frame: number;
  onframe(frame: number): void;
  /** What to paint; null while a setting cannot be parsed. */
  request: Omit<PreviewRequest, "frame" | "max_side_px"> | null;
  /** Called after each painting: with the problem, or null if it succeeded. */
  onpainted(problem: api.Problem | null): void;
}

export function Preview({ asset, localUrl, frame, onframe, request, onpainted }: PreviewProps) {
  const [original, setOriginal] = useState(true);
  const { painted, busy, failed } = usePainting(request && { ...request, frame, max_side_px: MAX_SIDE_PX }, onpainted);
  const { width = 16, height = 9, frames = 1, fps = 25 } = asset.info;
  return (
    <section
      class={`stage ${original ? "" : "no-original"} ${painted ? "painted" : ""}`}
      aria-label="Preview of one frame"
    >
      <div class="frame" aria-busy={busy} style={{ "--ratio": width / height }}>
        <Wipe
          before={<Original asset={asset} localUrl={localUrl} frame={frame} onfail={() => setOriginal(false)} />}
          after={<img class="picture" alt="The frame, painted" decoding="async" {...(painted && { src: painted })} />}
        />
        <div class="stage-busy" />
        <p class="stage-status">{!painted && (busy ? "Painting this frame…" : failed && "No preview")}</p>
      </div>
      <Scrubber frame={frame} frames={frames} fps={fps} onframe={onframe} />
    </section>
  );
}

/** The painted frame as an object URL. Requests are debounced, and only the newest counts. */
function usePainting(body: PreviewRequest | null, onpainted: (problem: api.Problem | null) => void) {
  const [state, setState] = useState({ painted: "", busy: false, failed: false });
  const shown = useRef("");
  const listener = useRef(onpainted);
  listener.current = onpainted;
  const text = JSON.stringify(body);
  useEffect(() => {
    if (!body) return;
    const controller = new AbortController();
    let timer = 0;
    const send = async (tries: number) => {
      try {
        const painted = URL.createObjectURL(await api.preview(body, controller.signal));
        if (controller.signal.aborted) return URL.revokeObjectURL(painted);
        if (shown.current) URL.revokeObjectURL(shown.current);
        shown.current = painted;
        setState({ painted, busy: false, failed: false });
        listener.current(null);
      } catch (error) {
        if (controller.signal.aborted) return;
        const problem = api.asProblem(error);
        if (problem.code === "busy" && tries < BUSY_TRIES) {
          timer = window.setTimeout(send, BUSY_MS, tries + 1);
        } else {
          setState((old) => ({ ...old, busy: false, failed: true }));
          listener.current(problem);
        }
      }
    };
    setState((old) => ({ ...old, busy: true }));
    timer = window.setTimeout(send, DEBOUNCE_MS, 0);
    return () => {
      clearTimeout(timer);
      controller.abort();
    };
  }, [text]);
  useEffect(() => () => URL.revokeObjectURL(shown.current), []);
  return state;
}

interface ScrubberProps {
  frame: number;
  frames: number;
  fps: number;
  onframe(frame: number): void;
}

function Scrubber({ frame, frames, fps, onframe }: ScrubberProps) {
  const last = Math.max(0, frames - 1);
  const label = `Frame ${frame + 1} of ${last + 1} · ${clock(frame / fps)}`;
  const step = (by: number) => onframe(Math.min(last, Math.max(0, frame + by)));
  return (
    <div class="scrubber">
      <IconButton name="back" label="Previous frame" onClick={() => step(-1)} />
      <input
        type="range"
        min="0"
        max={last}
        step="1"
        aria-label="Frame to preview"
        aria-valuetext={label}
        value={frame}
        style={{ "--fill": last > 0 ? frame / last : 0 }}
        onInput={(event) => onframe(Number(event.currentTarget.value))}
      />
      <IconButton name="next" label="Next frame" onClick={() => step(1)} />
      <output class="time">{label}</output>
    </div>
  );
}

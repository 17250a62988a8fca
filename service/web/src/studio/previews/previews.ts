/** Previews of the shown frame, requested when document and frame have not changed for a while, and shown coarse first. */

import { computed, effect } from "@preact/signals";
import * as api from "../../api/api";
import { hasPreviews, pictureOf, preview } from "../document/api";
import { type Layer, type ProjectDocument, picturesOf, shownAlone } from "../document/document";
import type { FrameHeader, PreviewRecord } from "../document/records";
import { PAINT_TOOLS, type Store } from "../state/store";

const REST_MS = 100;
/** A frame that is painted sooner comes without a coarse picture before it. */
const SOON_MS = 300;
const SIDE_PX = 960;
const BUSY_MS = 1200;
/** A frame near a painted key that has been looked at for so long is painted at full size. */
const FULL_REST_MS = 800;
const NEAR_FRAMES = 3;
const PAINTING = "Painting this frame";
const DRAFT = "A draft of this frame alone; painting it as in the film";
const ENLARGING = "Painting this frame at full size";

export interface Previews {
  /** A frame of the film, painted at the video's size; PNG. */
  full(frame: number): Promise<Blob>;
  /** A frame of the selected layer alone, as a document has it; PNG. */
  look(frame: number, document: ProjectDocument): Promise<Blob>;
  /** Find frames that are worth a key. */
  suggest(): Promise<void>;
  close(): void;
}

export function startPreviews(store: Store): Previews {
  let timer = 0;
  let running = new AbortController();
  const life = new AbortController();
  let ready = false;
  /** Whether the last frame took long. */
  let slow = true;

  hasPreviews(store.projectId).then((found) => {
    ready = true;
    store.previews.value = found;
    schedule();
  });

  const methods = computed(() => methodsShown(store));
  const forget = effect(() => {
    methods.value;
    store.results.value = new Map(); // pictures of another method
  });
  const dispose = effect(schedule);

  function schedule(): void {
    const document = store.document.value;
    const frame = store.frame.value;
    const layer = shownAlone(store.shot.value, store.layerId.value);
    const painting = PAINT_TOOLS.includes(store.tool.value);
    clearTimeout(timer);
    running.abort();
    const known = store.results.peek().get(frame);
    const done = known?.final && known.document === document && known.layer === layer;
    // With a brush, the stage shows the key itself.
    if (painting || done) notBusy();
    else if (ready && !store.removed) timer = window.setTimeout(() => paint(document, frame, layer), REST_MS);
  }

  function notBusy(): void {
    if ([PAINTING, DRAFT].some((text) => store.busy.peek().startsWith(text))) store.busy.value = "";
  }

  async function paint(document: ProjectDocument, frame: number, layer: string | undefined): Promise<void> {
    running = new AbortController();
    const { signal } = running;
    store.busy.value = `${PAINTING}…`;
    try {
      if (store.previews.value) await stream(document, frame, layer, signal);
      else await single(document, frame, signal);
      if (signal.aborted) return;
      store.problem.value = "";
      if (nearKey(frame)) timer = window.setTimeout(() => enlarge(document, frame, layer), FULL_REST_MS);
    } catch (error) {
      if (api.isAbort(error) || signal.aborted) return;
      const problem = api.asProblem(error);
      if (problem.status === 503) {
        timer = window.setTimeout(() => paint(document, frame, layer), BUSY_MS);
      } else {
        store.problem.value = [problem.message, problem.remedy].filter(Boolean).join(" ");
        store.dropResult(frame);
      }
    } finally {
      if (!signal.aborted) store.busy.value = "";
    }
  }

  /** Whether the frame follows a key that somebody paints. */
  function nearKey(frame: number): boolean {
    const layer = store.layer.peek();
    const keys = picturesOf(layer, store.section("keys", layer)?.part);
    const large = (store.results.peek().get(frame)?.scale ?? 1) < 0.999;
    return large && keys.some((key) => Math.abs(key.frame - frame) <= NEAR_FRAMES);
  }

  async function enlarge(document: ProjectDocument, frame: number, layer: string | undefined): Promise<void> {
    running = new AbortController();
    const { signal } = running;
    try {
      const picture = await createImageBitmap(await full(frame, signal));
      if (!signal.aborted) store.showResult({ frame, picture, scale: 1, final: true, document, layer });
    } catch (error) {
      if (!api.isAbort(error) && !signal.aborted) console.info("Impasto: no picture at full size.", error);
    }
  }

  async function stream(
    document: ProjectDocument,
    frame: number,
    layer: string | undefined,
    signal: AbortSignal,
  ): Promise<void> {
    const body = { document, shot: store.shot.peek().id, layer, frame, coarse: slow, max_side_px: SIDE_PX };
    let coarseMs = 0;
    let doing = `${PAINTING} as in the film`;
    const shown: Promise<void>[] = [];
    const show = async (header: FrameHeader, record: PreviewRecord) => {
      const picture = await pictureOf(record);
      const { frame: at, scale, final } = header;
      if (!signal.aborted) store.showResult({ frame: at, picture, scale, final, document, layer });
    };
    await preview({
      project: store.projectId,
      what: "paint",
      channel: "stage",
      body,
      signal,
      onrecord(record) {
        const { header } = record;
        if (header.type === "progress") store.busy.value = progressText(doing, header);
        if (header.type !== "frame") return;
        if (header.final) {
          slow = header.ms - coarseMs > SOON_MS;
          notBusy();
        } else {
          coarseMs = header.ms;
          doing = DRAFT;
          store.busy.value = `${DRAFT}…`;
        }
        shown.push(show(header, record));
      },
    });
    await Promise.all(shown);
  }

  /** A service without previews of projects: one frame by the layer's method, without painted keys and regions. */
  async function single(document: ProjectDocument, frame: number, signal: AbortSignal): Promise<void> {
    const layer = store.layer.peek();
    const body = { ...plainRequest(document, store.shot.peek().video, layer), frame, max_side_px: SIDE_PX };
    const picture = await createImageBitmap(await api.preview(body, signal));
    const scale = picture.width / store.size.width;
    if (!signal.aborted) store.showResult({ frame, picture, scale, final: true, document, layer: layer.id });
  }

  function full(frame: number, signal = life.signal): Promise<Blob> {
    const layer = shownAlone(store.shot.value, store.layerId.value);
    return atFullSize(frame, { document: store.document.value, layer }, "full", signal);
  }

  async function atFullSize(
    frame: number,
    of: { document: ProjectDocument; layer: string | undefined },
    channel: string,
    signal: AbortSignal,
  ): Promise<Blob> {
    const { width, height } = store.size;
    let found: Blob | null = null;
    store.busy.value = `${ENLARGING}…`;
    await preview({
      project: store.projectId,
      what: "paint",
      channel,
      body: { ...of, shot: store.shot.value.id, frame, coarse: false, max_side_px: Math.max(width, height) },
      signal,
      onrecord({ header, payload }) {
        if (header.type === "progress") store.busy.value = progressText(ENLARGING, header);
        if (header.type === "frame" && header.final) found = new Blob([payload], { type: header.media_type });
      },
    }).finally(notBusy);
    if (!found) throw new api.Problem({ detail: "The frame could not be painted.", remedy: "Try it again." });
    return found;
  }

  async function suggest(): Promise<void> {
    const place = { document: store.document.value, shot: store.shot.value.id, layer: store.layerId.value };
    await preview({
      project: store.projectId,
      what: "keys",
      channel: "keys",
      body: place,
      signal: life.signal,
      onrecord({ header }) {
        if (header.type === "progress") store.busy.value = shareText(header);
        if (header.type === "keys") store.suggested.value = header.frames;
      },
    }).finally(() => {
      store.busy.value = "";
    });
  }

  return {
    full: (frame) => full(frame),
    look: (frame, document) =>
      atFullSize(frame, { document, layer: store.layer.value.id }, `look-${frame}`, life.signal),
    suggest,
    close() {
      dispose();
      forget();
      clearTimeout(timer);
      running.abort();
      life.abort();
    },
  };
}

type Progress = { note: string; done: number };
const shareText = ({ note, done }: Progress): string => `${note}, ${Math.round(100 * done)} %`;
const progressText = (doing: string, header: Progress): string => `${doing}: ${shareText(header)}`;

/** What the stage shows, without parameters: the selected layer alone or all visible ones, and their methods. */
function methodsShown(store: Store): string {
  const alone = shownAlone(store.shot.value, store.layerId.value);
  const layers = store.shot.value.layers.filter((layer) => (alone ? layer.id === alone : layer.visible !== false));
  return layers.map((layer) => `${layer.id} ${layer.method}`).join();
}

function plainRequest(document: ProjectDocument, video: string, layer: Layer): Omit<api.JobBody, "output" | "name"> {
  const id = (name: string) => document.assets[name]?.id ?? "";
  const inputs = Object.fromEntries(Object.entries(layer.inputs ?? {}).map(([input, name]) => [input, id(name)]));
  return {
    method: layer.method,
    inputs: { video: id(video), ...inputs },
    params: layer.params ?? {},
    seed: layer.seed ?? 0,
  };
}

/** A finished film: the player, or the contact sheet where there is nothing a browser plays, and the downloads. */

import * as api from "../shared/api";
import { h } from "../shared/dom";
import { artefactTitle } from "../shared/format";
import { outputOf } from "../shared/formats";
import { icon } from "../shared/icons";
import { notify } from "../shared/notices";
import { mayPlay } from "../shared/stills";
import type { Job, View } from "../shared/types";
import { createExports } from "./exports";
import { createPlayer } from "./player";
import { createQuality } from "./quality";

const NOT_FILES = ["result", "poster", "preview"];

export interface Result extends View {
  downloads: HTMLElement;
}

export function createResult(job: Job): Result {
  const element = h("div", { class: "result" });
  const playback: Playback = { closed: false, close: () => {}, showFrame: () => {} };
  const { shownAs } = outputOf(job.request.output?.format);
  const shown = shownAs === "video" ? play : shownAs === "image" ? showImage : showSheet;
  shown(job, element, playback).catch(notify);
  const exports = createExports(job);
  const quality = createQuality(job, (frame) => playback.showFrame(frame));
  return {
    element: h("div", { class: "result-and-quality" }, element, quality),
    downloads: downloads(job, exports?.element),
    close() {
      exports?.close();
      playback.closed = true;
      playback.close();
    },
  };
}

interface Playback {
  closed: boolean;
  close(): void;
  /** Stop at this frame of the film. */
  showFrame(frame: number): void;
}

async function play(job: Job, element: HTMLElement, playback: Playback): Promise<void> {
  const asset = await api.asset(job.request.inputs.video ?? "");
  const [before, after, poster] = await Promise.all([
    mayPlay(asset) ? api.mediaUrl(api.paths.content(asset.id)) : "",
    api.mediaUrl(api.paths.result(job.id)),
    job.results.includes("poster") ? api.mediaUrl(api.paths.file(job.id, "poster")) : null,
  ]);
  if (playback.closed) return;
  const player = createPlayer({ asset, before, after, poster, first: job.request.frames?.[0] ?? 0 });
  playback.close = player.close;
  playback.showFrame = player.showFrame;
  element.append(player.element);
}

async function showSheet(job: Job, element: HTMLElement): Promise<void> {
  const name = ["sheet", "poster"].find((file) => job.results.includes(file));
  if (!name) return;
  const src = await api.mediaUrl(api.paths.file(job.id, name));
  element.append(h("img", { class: "sheet", alt: "Contact sheet of the frames", src }));
}

async function showImage(job: Job, element: HTMLElement): Promise<void> {
  const src = await api.mediaUrl(api.paths.result(job.id));
  element.append(h("img", { class: "sheet", alt: "The painted film", src }));
}

function downloads(job: Job, exports: HTMLElement | undefined): HTMLElement {
  const save = (path: string) => () => api.download(path).catch(notify);
  const text = `Download ${outputOf(job.request.output?.format).file}`;
  const onclick = save(api.paths.result(job.id));
  const main = h("button", { type: "button", class: "button primary", onclick }, icon("download"), text);
  const others = job.results.filter((name) => !NOT_FILES.includes(name));
  const more = others.map((name) =>
    h("button", { type: "button", class: "button small", onclick: save(api.paths.file(job.id, name)) }, label(name)),
  );
  return h(
    "div",
    { class: "downloads" },
    main,
    exports,
    more.length > 0 && h("div", { class: "downloads-more" }, more),
  );
}

const label = (name: string): string => (name === "sheet" ? "Contact sheet" : artefactTitle(name));

/** A finished film: the player, or the contact sheet where there is nothing a browser plays, and the downloads. */

import * as api from "./api.js";
import { h, icon } from "./dom.js";
import { artefactTitle } from "./format.js";
import { notify } from "./notices.js";
import { createPlayer } from "./player.js";
import { mayPlay } from "./stills.js";

const NOT_FILES = ["result", "poster", "preview"];

/** @returns {{element, downloads, close()}} */
export function createResult(job) {
  const element = h("div", { class: "result" });
  const life = { closed: false, close: () => {} };
  const playable = job.request.output?.format !== "png";
  (playable ? play : hang)(job, element, life).catch(notify);
  return { element, downloads: downloads(job), close: () => ((life.closed = true), life.close()) };
}

async function play(job, element, life) {
  const video = await api.asset(job.request.inputs.video);
  const addresses = [mayPlay(video) && api.paths.content(video.id), api.paths.result(job.id), job.results.includes("poster") && api.paths.file(job.id, "poster")];
  const [before, after, poster] = await Promise.all(addresses.map((path) => path && api.mediaUrl(path)));
  if (life.closed) return;
  const player = createPlayer({ asset: video, before, after, poster: poster || null });
  life.close = player.close;
  element.append(player.element);
}

async function hang(job, element) {
  const name = ["sheet", "poster"].find((file) => job.results.includes(file));
  if (name) element.append(h("img", { class: "sheet", alt: "Contact sheet of the frames", src: await api.mediaUrl(api.paths.file(job.id, name)) }));
}

function downloads(job) {
  const format = job.request.output?.format ?? "mp4";
  const save = (path) => () => api.download(path).catch(notify);
  const text = `Download ${format === "png" ? "ZIP" : format === "webm" ? "WebM" : "MP4"}`;
  const main = h("button", { type: "button", class: "button primary", onclick: save(api.paths.result(job.id)) }, icon("download"), text);
  const others = job.results.filter((name) => !NOT_FILES.includes(name));
  const more = others.map((name) => h("button", { type: "button", class: "button small", onclick: save(api.paths.file(job.id, name)) }, label(name)));
  return h("div", { class: "downloads" }, main, more.length > 0 && h("div", { class: "downloads-more" }, more));
}

const label = (name) => (name === "sheet" ? "Contact sheet" : artefactTitle(name));

/** A project that somebody has shared by a link: its video and its finished films, to look at only. */

import * as api from "../api/api";
import type { Job, Page } from "../api/schemas";
import type { View } from "../ui/dom";
import { h } from "../ui/dom";
import { ago } from "../ui/format";

interface SharedProject {
  name: string;
  updated_at: number;
  document: { assets: Record<string, { id: string }>; shots: { video: string }[] };
}

interface SharedJob {
  job: Job | null;
  variant: string | null;
}

const PLAYED = new Set(["mp4", "webm"]);

export async function createSharedPage(token: string): Promise<View> {
  const at = api.url`/v1/shared/${token}`;
  const read = async <T>(path: string): Promise<T> => (await api.request(path)).json();
  const [project, { items }] = await Promise.all([read<SharedProject>(at), read<Page<SharedJob>>(`${at}/jobs`)]);
  document.title = `${project.name} · Impasto`;
  const finished = items.flatMap(({ job }) => (job?.state === "succeeded" ? [job] : []));
  const films = finished.map((job) => {
    const title = job.request.name || project.name;
    const path = `${at}/jobs/${job.id}/result`;
    const format = String(job.request.output?.format ?? "mp4");
    const film = PLAYED.has(format)
      ? h("video", {
          src: path,
          controls: true,
          muted: true,
          playsinline: "",
          preload: "metadata",
          "aria-label": title,
        })
      : h("a", { class: "button", href: path, download: "" }, `Download ${format.toUpperCase()}`);
    return h("li", {}, h("h2", {}, title), film);
  });
  const shot = project.document.shots[0];
  const original = shot && project.document.assets[shot.video]?.id;
  const source =
    original &&
    h("video", {
      src: `${at}/assets/${original}/content`,
      controls: true,
      muted: true,
      playsinline: "",
      preload: "metadata",
      "aria-label": "The original video",
    });
  const element = h(
    "div",
    { class: "shared-page" },
    h("h1", {}, project.name),
    h("p", { class: "hint" }, `Shared with you to look at. Changed ${ago(project.updated_at)}.`),
    films.length ? h("ul", { class: "shared-films" }, films) : h("p", {}, "No film of it is finished yet."),
    source ? h("section", {}, h("h2", {}, "Original"), source) : false,
  );
  return { element, close() {} };
}

/** What is being set up on the studio page, kept in the address so that a reload or a link brings it back. */

import type { Inputs, Job, Params } from "../api/schemas";

export interface Draft {
  /** Name of the method, or empty. */
  method: string;
  /** Id of the video asset, or empty. */
  video: string;
  /** The other inputs. */
  inputs: Inputs;
  /** Only those that differ from the defaults. */
  params: Params;
  /** Values of the output form: format, quality, seed, name. */
  film: Params;
  /** Index of the previewed frame. */
  frame: number | null;
}

export function readDraft(query: string): Draft {
  const found = new URLSearchParams(query);
  const inputs = [...found].filter(([name]) => name.startsWith("in."));
  return {
    method: found.get("method") ?? "",
    video: found.get("video") ?? "",
    inputs: Object.fromEntries(inputs.map(([name, id]) => [name.slice(3), id])),
    params: parseObject(found.get("params")),
    film: parseObject(found.get("film")),
    frame: found.has("frame") ? Number(found.get("frame")) : null,
  };
}

/** The address of the studio page for a draft. */
export function draftHash({
  method,
  video,
  inputs = {},
  params = {},
  film = {},
  frame = null,
}: Partial<Draft>): string {
  const query = new URLSearchParams();
  if (method) query.set("method", method);
  if (video) query.set("video", video);
  for (const [name, id] of Object.entries(inputs)) query.set(`in.${name}`, id);
  if (Object.keys(params).length) query.set("params", JSON.stringify(params));
  if (Object.keys(film).length) query.set("film", JSON.stringify(film));
  if (frame !== null) query.set("frame", String(frame));
  return `#/?${query}`;
}

/** The address of the page with the settings of a job: its project, if it has one. */
export function hashOfJob({ request }: Job): string {
  const project = request.labels?.project;
  if (project) return `#/projects/${encodeURIComponent(project)}`;
  const { video = "", ...inputs } = request.inputs;
  return draftHash({ method: request.method, video, inputs, params: request.params });
}

function parseObject(text: string | null): Params {
  try {
    const value: unknown = JSON.parse(text ?? "{}");
    return value !== null && typeof value === "object" && !Array.isArray(value) ? { ...value } : {};
  } catch {
    return {};
  }
}

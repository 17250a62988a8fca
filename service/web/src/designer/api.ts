/** Projects and their previews over HTTP. */

import { get, Problem, post, problemOf, request, url } from "../shared/api";
import type { Job, Page } from "../shared/types";
import type { ProjectDocument } from "./document";
import { type PreviewHeader, type PreviewRecord, RecordReader } from "./records";

export interface ProjectInfo {
  id: string;
  name: string;
  version: number;
  updated_at: number;
}

export interface Project extends ProjectInfo {
  document: ProjectDocument;
}

export interface ProjectFault {
  /** JSON Pointer into the document. */
  path: string;
  message: string;
  remedy: string;
}

export const listProjects = (limit: number): Promise<Page<ProjectInfo>> => get(url`/v1/projects?limit=${limit}`);
export const readProject = (id: string): Promise<Project> => get(url`/v1/projects/${id}`);

export const createProject = async (document: ProjectDocument): Promise<Project> =>
  (await post("/v1/projects", { name: document.name, document })).json();

export const deleteProject = (id: string): Promise<Response> => request(url`/v1/projects/${id}`, { method: "DELETE" });

/** Save a document over the given version; the new version. Throws a Problem with status 412 if another one is stored. */
export async function saveProject(id: string, document: ProjectDocument, version: number): Promise<number> {
  const headers = { "If-Match": `"${version}"` };
  const answer = await post(url`/v1/projects/${id}`, document, { method: "PUT", headers });
  return ((await answer.json()) as ProjectInfo).version;
}

export interface ProjectJob {
  job: Job;
  shot: string;
  variant: string | null;
}

export interface JobWishes {
  variants?: string[];
  range?: [number, number];
}

export async function submitProject(id: string, wishes: JobWishes, token: string): Promise<ProjectJob[]> {
  const headers = { "Idempotency-Key": token };
  const answer = await post(url`/v1/projects/${id}/jobs`, wishes, { headers });
  return ((await answer.json()) as { items: ProjectJob[] }).items;
}

export const checkProject = async (id: string): Promise<ProjectFault[]> =>
  (await get<{ errors: ProjectFault[] }>(url`/v1/projects/${id}/check`)).errors;

export interface Estimate {
  items: { frames: number; seconds: number | null }[];
  jobs_ahead: number;
  ahead_s: number | null;
}

export const estimate = async (id: string): Promise<Estimate> => (await post("/v1/estimates", { project: id })).json();

// -- previews ---------------------------------------------------------------------------------------------------------

/** Whether the service previews projects. */
export async function hasPreviews(project: string): Promise<boolean> {
  const answer = await request(url`/v1/projects/${project}/previews/state`).catch(() => null);
  return answer !== null;
}

const CLIENT = `tab-${Math.floor(Math.random() * 2 ** 32).toString(16)}`;
let sequence = 0;

export interface PreviewOptions {
  project: string;
  what: "paint" | "source" | "regions" | "directions" | "keys" | "spread" | "styles" | "propagate";
  /** Later requests of the same channel cancel earlier ones. */
  channel: string;
  body: object;
  signal: AbortSignal;
  onrecord(record: PreviewRecord): void;
}

/** Run one preview to its end. Resolves when the stream has ended; false if a later request has overtaken it. */
export async function preview({ project, what, channel, body, signal, onrecord }: PreviewOptions): Promise<boolean> {
  sequence += 1;
  const whole = { client: CLIENT, channel, seq: sequence, ...body };
  const response = await post(`${url`/v1/projects/${project}/previews/`}${what}`, whole, { signal });
  if (!response.body) throw await problemOf(response);
  const reader = response.body.getReader();
  const records = new RecordReader();
  for (let part = await reader.read(); !part.done; part = await reader.read()) {
    for (const record of records.push(part.value)) {
      if (record.header.type === "error") throw new Problem(record.header.problem);
      if (record.header.type === "overtaken") return false;
      onrecord(record);
    }
  }
  return !signal.aborted;
}

/** The payload of a record as a picture. */
export function pictureOf(record: PreviewRecord): Promise<ImageBitmap> {
  const header: PreviewHeader = record.header;
  const type = "media_type" in header ? header.media_type : "image/png";
  return createImageBitmap(new Blob([record.payload], { type }));
}

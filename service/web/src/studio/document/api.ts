/** Projects and their previews over HTTP. */

import { Problem, post, problemOf, request, url } from "../../api/api";
import { bodyOf, client } from "../../api/client";
import type { Job, Output, Page, Schemas } from "../../api/schemas";
import type { ProjectDocument } from "./document";
import { type PreviewHeader, type PreviewRecord, RecordReader } from "./records";

export type ProjectInfo = Schemas["ProjectOut"];
export type Project = ProjectInfo & { document: ProjectDocument };
export type ProjectFault = Schemas["DocumentFault"];
export type ProjectVersion = Schemas["ProjectVersion"];
export type ProjectJob = Omit<Schemas["ProjectJobOut"], "job"> & { job: Job };

const at = (id: string) => ({ path: { project_id: id } });

export const listProjects = (limit: number): Promise<Page<ProjectInfo>> =>
  bodyOf(client.GET("/v1/projects", { params: { query: { limit } } }));

export const readProject = async (id: string): Promise<Project> =>
  (await bodyOf(client.GET("/v1/projects/{project_id}", { params: at(id) }))) as unknown as Project;

export const createProject = async (document: ProjectDocument): Promise<Project> => {
  const body = { name: document.name, document: { ...document } };
  return (await bodyOf(client.POST("/v1/projects", { body }))) as unknown as Project;
};

export const deleteProject = async (id: string): Promise<void> => {
  await client.DELETE("/v1/projects/{project_id}", { params: at(id), keepalive: true });
};

/** Save a document over the given version; the new version. Throws a Problem with status 412 if another one is stored. */
export async function saveProject(id: string, document: ProjectDocument, version: number): Promise<number> {
  const params = { ...at(id), header: { "if-match": `"${version}"` } };
  const saved = await bodyOf(client.PUT("/v1/projects/{project_id}", { params, body: { ...document } }));
  return saved.version;
}

/** The project's jobs, newest first; those that were deleted are left out. */
export const projectJobs = async (id: string): Promise<ProjectJob[]> =>
  ((await bodyOf(client.GET("/v1/projects/{project_id}/jobs", { params: at(id) }))).items as ProjectJob[]).filter(
    (one) => one.job,
  );

export interface JobWishes {
  /** Instead of the document's. */
  output?: Output;
  variants?: string[];
  /** Instead of all. */
  shots?: string[];
  range?: [number, number];
  /** Leave out shots whose film shows the same. */
  changed?: boolean;
}

export async function submitProject(id: string, wishes: JobWishes, token: string): Promise<ProjectJob[]> {
  const params = { ...at(id), header: { "idempotency-key": token } };
  const page = await bodyOf(client.POST("/v1/projects/{project_id}/jobs", { params, body: wishes }));
  return page.items as ProjectJob[];
}

/** The newest versions, newest first. */
export const listVersions = async (id: string): Promise<ProjectVersion[]> =>
  (await bodyOf(client.GET("/v1/projects/{project_id}/versions", { params: at(id) }))).items;

/** Give a version a name or a note, which keeps it; empty takes it away. */
export const nameVersion = async (id: string, version: number, label: string): Promise<void> => {
  const params = { path: { project_id: id, version } };
  await bodyOf(client.PUT("/v1/projects/{project_id}/versions/{version}/label", { params, body: { label } }));
};

/** Save the document of an earlier version as a new one. */
export async function restoreVersion(id: string, version: number, present: number): Promise<void> {
  const params = { path: { project_id: id, version }, header: { "if-match": `"${present}"` } };
  await bodyOf(client.POST("/v1/projects/{project_id}/versions/{version}/restore", { params }));
}

/** A link that shows the project and its films to anyone who has it, for `days`; with `comments` they may comment. */
export async function shareProject(id: string, days: number, comments: boolean): Promise<string> {
  const { url: path } = await bodyOf(
    client.POST("/v1/projects/{project_id}/share", { params: at(id), body: { days, comments } }),
  );
  return new URL(path, location.origin).href;
}

export const endShares = async (id: string): Promise<void> => {
  await client.DELETE("/v1/projects/{project_id}/share", { params: at(id) });
};

export type Comment = Schemas["Comment"];
export type CommentDraft = Schemas["CommentIn"];

export const listComments = async (id: string): Promise<readonly Comment[]> =>
  (await bodyOf(client.GET("/v1/projects/{project_id}/comments", { params: at(id) }))).items as Comment[];

export const addComment = async (id: string, body: CommentDraft): Promise<Comment> =>
  bodyOf(client.POST("/v1/projects/{project_id}/comments", { params: at(id), body }));

export const deleteComment = async (id: string, comment: string): Promise<void> => {
  const params = { path: { project_id: id, comment_id: comment } };
  await client.DELETE("/v1/projects/{project_id}/comments/{comment_id}", { params });
};

/** The project and its assets as a zip file. */
export const exportProject = async (id: string): Promise<Blob> =>
  (await request(url`/v1/projects/${id}/export`)).blob();

/** A new project from an exported zip file. */
export async function importProject(file: File): Promise<ProjectInfo> {
  const headers = { "Content-Type": "application/zip" };
  return (await request("/v1/projects/import", { method: "POST", body: file, headers })).json();
}

export const checkProject = async (id: string): Promise<ProjectFault[]> =>
  (await bodyOf(client.GET("/v1/projects/{project_id}/check", { params: at(id) }))).errors;

export type Estimate = Schemas["EstimatesOut"];

/** `shots`: null for all. */
export const estimate = (id: string, shots: string[] | null): Promise<Estimate> =>
  bodyOf(client.POST("/v1/estimates", { body: { project: id, shots } }));

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
  what:
    | "paint"
    | "source"
    | "regions"
    | "directions"
    | "keys"
    | "cuts"
    | "spread"
    | "object"
    | "matte"
    | "styles"
    | "propagate"
    | "flicker"
    | "clusters";
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

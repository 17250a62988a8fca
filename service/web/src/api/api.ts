/** The service's HTTP API as functions, over the client that is generated from its OpenAPI document. */

import { under } from "./base";
import { blobOf, bodyOf, client } from "./client";
import { key, request, url } from "./http";
import type { Asset, Inputs, Job, Method, Output, Page, Params, PreviewRequest, RunState } from "./schemas";

export * from "./http";

export const methods = async (): Promise<Method[]> => (await bodyOf(client.GET("/v1/methods"))).items as Method[];

export const asset = (id: string): Promise<Asset> =>
  bodyOf(client.GET("/v1/assets/{asset_id}", { params: { path: { asset_id: id } } }));

const ofJob = (id: string) => ({ params: { path: { job_id: id } } });

export const job = async (id: string, signal?: AbortSignal): Promise<Job> =>
  (await bodyOf(client.GET("/v1/jobs/{job_id}", { ...ofJob(id), signal: signal ?? null }))) as Job;

export interface JobSearch {
  /** Words that name, method or labels contain. */
  search?: string;
  /** A state, or "active" for all that are not final. */
  state?: RunState | "active";
}

export const jobs = async (limit: number, wanted: JobSearch = {}, cursor = ""): Promise<Page<Job>> => {
  const query = { limit, ...wanted, ...(cursor && { cursor }) };
  return (await bodyOf(client.GET("/v1/jobs", { params: { query } }))) as Page<Job>;
};

/** Delete a job; the request is completed even if the page is left meanwhile. */
export const forget = async (id: string): Promise<void> => {
  await client.DELETE("/v1/jobs/{job_id}", { ...ofJob(id), keepalive: true });
};

export type JobVerb = "cancel" | "pause" | "resume" | "retry";

/** Resolves to the job after the action. */
export const act = async (id: string, verb: JobVerb): Promise<Job> =>
  (await bodyOf(client.POST(`/v1/jobs/{job_id}/${verb}`, ofJob(id)))) as Job;

export interface JobBody {
  method: string;
  inputs: Inputs;
  params: Params;
  seed: number;
  output: Output;
  name: string;
}

/** Submit a job; the same `token` twice is the same job. */
export const submit = async (body: JobBody, token: string): Promise<Job> =>
  (await bodyOf(client.POST("/v1/jobs", { body, params: { header: { "idempotency-key": token } } }))) as Job;

/** One stylised frame, a PNG blob. */
export const preview = (body: PreviewRequest, signal: AbortSignal): Promise<Blob> =>
  blobOf(client.POST("/v1/previews", { body, signal, parseAs: "stream" }));

/** A random token of 32 hexadecimal digits; `crypto.randomUUID` exists in secure contexts only. */
export function token(): string {
  return Array.from(crypto.getRandomValues(new Uint8Array(16)), (byte) => byte.toString(16).padStart(2, "0")).join("");
}

export const paths = {
  content: (assetId: string): string => url`/v1/assets/${assetId}/content`,
  frame: (assetId: string, index: number, sidePx: number): string =>
    url`/v1/assets/${assetId}/frame?index=${index}&max_side_px=${sidePx}`,
  result: (jobId: string): string => url`/v1/jobs/${jobId}/result`,
  file: (jobId: string, name: string): string => url`/v1/jobs/${jobId}/files/${name}`,
  events: (jobId: string): string => url`/v1/jobs/${jobId}/events`,
};

/** The bytes at `path` as an object URL, which the caller revokes. */
export async function objectUrl(path: string, signal?: AbortSignal): Promise<string> {
  return URL.createObjectURL(await (await request(path, { signal: signal ?? null })).blob());
}

/**
 * An address that media elements can load: the path itself, or an object URL where a key is needed, for elements send
 * no Authorization header.
 */
export const mediaUrl = (path: string): Promise<string> => (key() ? objectUrl(path) : Promise.resolve(under(path)));

/** Save a file of the service under the name that the service gives it. */
export async function download(path: string): Promise<void> {
  const link = document.createElement("a");
  link.href = under(`${path}${path.includes("?") ? "&" : "?"}download=true`);
  link.download = "";
  if (key()) await pointAtBytes(link);
  link.click();
}

/** A link cannot send the key: fetch the bytes, and let it point at them. */
async function pointAtBytes(link: HTMLAnchorElement): Promise<void> {
  const response = await request(link.href);
  const disposition = response.headers.get("Content-Disposition") ?? "";
  saveBlob(await response.blob(), /filename="([^"]+)"/.exec(disposition)?.[1] ?? "", link);
}

/** Let `link` save `blob` as `name`; the bytes are released after a minute. */
function saveBlob(blob: Blob, name: string, link: HTMLAnchorElement): void {
  link.download = name;
  link.href = URL.createObjectURL(blob);
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

/** Save bytes that the page has made. */
export function saveFile(blob: Blob, name: string): void {
  const link = document.createElement("a");
  saveBlob(blob, name, link);
  link.click();
}

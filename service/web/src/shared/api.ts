/** The service's HTTP API as functions. Every failure is a `Problem` (RFC 9457) with a field and a remedy. */

import type { Asset, Inputs, Job, Json, Method, Output, Page, Params, PreviewRequest } from "./types";

const KEY = "impasto.key";

/** Fields of a problem+json answer. */
export interface ProblemFields {
  title?: string;
  detail?: string;
  code?: string;
  field?: string;
  value?: Json;
  remedy?: string;
  status?: number;
}

/** What went wrong, why, and what to do: `field` is the dotted path of the input that caused it, or empty. */
export class Problem extends Error {
  readonly title: string;
  readonly code: string;
  readonly field: string;
  readonly remedy: string;
  /** HTTP status, or 0 if there was no answer. */
  readonly status: number;

  constructor({ title = "", detail = "", code = "", field = "", remedy = "", status = 0 }: ProblemFields) {
    super(detail || title || "Something went wrong.");
    this.title = title;
    this.code = code;
    this.field = field || "";
    this.remedy = remedy || "";
    this.status = status;
  }
}

/** Whether an error is the abort of a request that nobody waits for any more. */
export const isAbort = (error: unknown): boolean => error instanceof Error && error.name === "AbortError";

/** Any thrown value as a Problem. */
export function asProblem(error: unknown): Problem {
  if (error instanceof Problem) return error;
  console.error(error);
  return new Problem({ detail: error instanceof Error ? error.message : String(error), code: "page" });
}

const offline = (): Problem =>
  new Problem({
    title: "No answer",
    detail: "The service does not answer.",
    code: "offline",
    remedy: "Check that it is running and that you are connected; then try again.",
  });

/** A response that is not a success, as a `Problem`. */
export async function problemOf(response: Response): Promise<Problem> {
  const body: ProblemFields = await response.json().catch(() => ({}));
  const detail = typeof body.detail === "string" ? body.detail : `The service answered ${response.status}.`;
  return new Problem({ ...body, detail, status: response.status });
}

const key = (): string | null => sessionStorage.getItem(KEY);

/** Headers that every request carries. */
export const authorisation = (): Record<string, string> => (key() ? { Authorization: `Bearer ${key()}` } : {});

type AskForKey = (refused: boolean) => Promise<string>;
let prompt: AskForKey | null = null;
let asking: Promise<void> | null = null;

/** Install what asks the user for an API key; it is called only when the service answers 401. */
export function onKeyNeeded(ask: AskForKey): void {
  prompt = ask;
}

/** Ask once, however many requests were refused meanwhile. `refused`: the key that the service did not accept. */
export function renewKey(refused: string | null | undefined): Promise<void> {
  if ((key() && key() !== refused) || !prompt) return Promise.resolve();
  asking ??= prompt(Boolean(refused))
    .then((given) => sessionStorage.setItem(KEY, given))
    .finally(() => {
      asking = null;
    });
  return asking;
}

export interface RequestOptions extends Omit<RequestInit, "headers"> {
  headers?: Record<string, string>;
}

/** Fetch with the key, asking for one on 401. Resolves to a successful Response, else throws a Problem. */
export async function request(path: string, { headers = {}, ...options }: RequestOptions = {}): Promise<Response> {
  const used = key();
  const response = await fetch(path, { ...options, headers: { ...authorisation(), ...headers } }).catch((error) => {
    throw isAbort(error) ? error : offline();
  });
  if (response.status === 401 && prompt) {
    await renewKey(used);
    return request(path, { headers, ...options });
  }
  if (!response.ok) throw await problemOf(response);
  return response;
}

/** The JSON at `path`. */
export async function get<Body>(path: string, signal?: AbortSignal): Promise<Body> {
  return (await request(path, { signal: signal ?? null })).json();
}

/** Send a JSON body. */
export function post(path: string, body: unknown, options: RequestOptions = {}): Promise<Response> {
  const headers = { "Content-Type": "application/json", ...options.headers };
  return request(path, { ...options, method: options.method ?? "POST", headers, body: JSON.stringify(body) });
}

/** A path of which every inserted value is percent-encoded. */
export function url(strings: TemplateStringsArray, ...values: (string | number)[]): string {
  return String.raw({ raw: strings }, ...values.map((value) => encodeURIComponent(value)));
}

export const methods = async (): Promise<Method[]> => (await get<Page<Method>>("/v1/methods")).items;
export const asset = (id: string): Promise<Asset> => get(url`/v1/assets/${id}`);
export const job = (id: string, signal?: AbortSignal): Promise<Job> => get(url`/v1/jobs/${id}`, signal);
export const jobs = (limit: number, cursor = ""): Promise<Page<Job>> =>
  get(url`/v1/jobs?limit=${limit}` + (cursor && url`&cursor=${cursor}`));
export const forget = (id: string): Promise<Response> => request(url`/v1/jobs/${id}`, { method: "DELETE" });

export type JobVerb = "cancel" | "pause" | "resume" | "retry";

/** Resolves to the job as it is after the action. */
export const act = async (id: string, verb: JobVerb): Promise<Job> =>
  (await request(url`/v1/jobs/${id}/${verb}`, { method: "POST" })).json();

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
  (await post("/v1/jobs", body, { headers: { "Idempotency-Key": token } })).json();

/** One stylised frame, a PNG blob. */
export const preview = async (body: PreviewRequest, signal: AbortSignal): Promise<Blob> =>
  (await post("/v1/previews", body, { signal })).blob();

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
export const mediaUrl = (path: string): Promise<string> => (key() ? objectUrl(path) : Promise.resolve(path));

/** Save a file of the service under the name that the service gives it. */
export async function download(path: string): Promise<void> {
  const link = document.createElement("a");
  link.href = `${path}?download=true`;
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

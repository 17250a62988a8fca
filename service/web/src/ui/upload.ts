/** Sending a file to the service: one POST for a small one, resumable tus 1.0.0 for a large one. */

import { asset, authorisation, isAbort, Problem, type ProblemFields, renewKey, request } from "../api/api";
import { under } from "../api/base";
import type { Asset } from "../api/schemas";
import { notifyOf } from "./notices";

const TUS = { "Tus-Resumable": "1.0.0" };
const SMALL_BYTES = 32 * 2 ** 20;
const CHUNK_BYTES = 8 * 2 ** 20;
const PAUSE_MS = [500, 1000, 2000, 4000, 8000];

export interface UploadOptions {
  /** Called with the fraction of bytes that were sent, 0..1. */
  onProgress?: (fraction: number) => void;
  signal?: AbortSignal;
}

/** Upload `file`, and tell the user if it is damaged. Resolves to the asset, throws a Problem. */
export async function upload(file: File, { onProgress = () => {}, signal }: UploadOptions = {}): Promise<Asset> {
  if (!file.size) throw empty(file);
  const small = file.size <= SMALL_BYTES;
  const found = await (small ? whole(file, onProgress, signal) : resumable(file, onProgress, signal));
  if (found.info.damage) notifyOf({ title: file.name, message: found.info.damage, remedy: DAMAGED });
  return found;
}

const DAMAGED = "What can be read of it is used. Choose an undamaged copy if you have one.";

const empty = (file: File): Problem =>
  new Problem({
    detail: `“${file.name}” is empty.`,
    field: "file",
    code: "unreadable-media",
    remedy: "Choose another file.",
  });

async function whole(file: File, onProgress: (fraction: number) => void, signal?: AbortSignal): Promise<Asset> {
  const body = new FormData();
  body.append("file", file, file.name);
  const answer = await send({ verb: "POST", path: "/v1/assets", body, onProgress, signal });
  return JSON.parse(answer.responseText);
}

interface Sending {
  verb: string;
  path: string;
  body: FormData | Blob;
  headers?: Record<string, string>;
  onProgress(fraction: number): void;
  signal: AbortSignal | undefined;
}

/** XMLHttpRequest, since fetch does not report the progress of an upload. */
async function send(sending: Sending): Promise<XMLHttpRequest> {
  const auth = authorisation();
  try {
    return await sendOnce(sending, auth);
  } catch (error) {
    if (!(error instanceof Problem) || error.status !== 401) throw error;
    await renewKey(auth.Authorization?.slice("Bearer ".length));
    return send(sending);
  }
}

function sendOnce(sending: Sending, auth: Record<string, string>): Promise<XMLHttpRequest> {
  const { verb, path, body, headers = {}, onProgress, signal } = sending;
  return new Promise((resolve, reject) => {
    const xhr = new XMLHttpRequest();
    xhr.open(verb, under(path));
    for (const [name, value] of Object.entries({ ...auth, ...headers })) xhr.setRequestHeader(name, value);
    xhr.upload.onprogress = (event) => event.lengthComputable && onProgress(event.loaded / event.total);
    xhr.onload = () => (xhr.status < 300 ? resolve(xhr) : reject(refusal(xhr)));
    xhr.onerror = () => reject(broken());
    xhr.onabort = () => reject(new DOMException("Upload stopped", "AbortError"));
    signal?.addEventListener("abort", () => xhr.abort(), { once: true });
    xhr.send(body);
  });
}

const broken = (): Problem =>
  new Problem({
    detail: "The connection broke.",
    code: "offline",
    field: "file",
    remedy: "Try again; the upload of a large file continues where it stopped.",
  });

function refusal(xhr: XMLHttpRequest): Problem {
  try {
    const fields: ProblemFields = JSON.parse(xhr.responseText);
    return new Problem({ field: "file", ...fields, status: xhr.status });
  } catch {
    return new Problem({ detail: `The service answered ${xhr.status}.`, status: xhr.status, field: "file" });
  }
}

// -- tus ------------------------------------------------------------------------------------------------------------

const memory = (file: File): string => `impasto.upload:${file.name}:${file.size}:${file.lastModified}`;

interface Place {
  path: string;
  offset: number;
}

async function resumable(file: File, onProgress: (fraction: number) => void, signal?: AbortSignal): Promise<Asset> {
  const place = (await resume(file, signal)) ?? (await create(file, signal));
  for (let failures = 0; ; ) {
    try {
      const answer = await sendChunk(file, place, onProgress, signal);
      place.offset = Number(answer.getResponseHeader("Upload-Offset"));
      failures = 0;
      if (place.offset >= file.size) return await finished(file, answer);
    } catch (error) {
      const offline = error instanceof Problem && error.code === "offline";
      const pause = PAUSE_MS[failures];
      if (!offline || pause === undefined) throw forgetting(file, error);
      failures += 1;
      await new Promise((done) => setTimeout(done, pause));
      place.offset = (await offsetAt(place.path, signal)) ?? place.offset;
    }
  }
}

/** A refused upload must not be resumed; one that was only interrupted must. */
function forgetting(file: File, error: unknown): unknown {
  if (error instanceof Problem && error.status) localStorage.removeItem(memory(file));
  return error;
}

function sendChunk(
  file: File,
  { path, offset }: Place,
  onProgress: (fraction: number) => void,
  signal?: AbortSignal,
): Promise<XMLHttpRequest> {
  const body = file.slice(offset, offset + CHUNK_BYTES);
  return send({
    verb: "PATCH",
    path,
    body,
    signal,
    headers: { ...TUS, "Upload-Offset": String(offset), "Content-Type": "application/offset+octet-stream" },
    onProgress: (fraction) => onProgress((offset + fraction * body.size) / file.size),
  });
}

async function create(file: File, signal?: AbortSignal): Promise<Place> {
  const name = btoa(String.fromCharCode(...new TextEncoder().encode(file.name)));
  const headers = { ...TUS, "Upload-Length": String(file.size), "Upload-Metadata": `filename ${name}` };
  const response = await request("/v1/uploads", { method: "POST", headers, signal: signal ?? null });
  const path = new URL(response.headers.get("Location") ?? "", location.href).pathname;
  localStorage.setItem(memory(file), path);
  return { path, offset: 0 };
}

async function resume(file: File, signal?: AbortSignal): Promise<Place | null> {
  const path = localStorage.getItem(memory(file));
  const offset = path ? await offsetAt(path, signal) : null;
  return path && offset !== null && offset < file.size ? { path, offset } : null;
}

/** Bytes the service has, or null if it does not know the upload. */
async function offsetAt(path: string, signal?: AbortSignal): Promise<number | null> {
  try {
    const response = await request(path, { method: "HEAD", headers: TUS, signal: signal ?? null });
    return Number(response.headers.get("Upload-Offset"));
  } catch (error) {
    if (isAbort(error)) throw error;
    return null;
  }
}

function finished(file: File, answer: XMLHttpRequest): Promise<Asset> {
  localStorage.removeItem(memory(file));
  const id = answer.getResponseHeader("Impasto-Asset");
  if (!id) throw new Problem({ detail: "The upload has no asset.", field: "file", remedy: "Upload the file again." });
  return asset(id);
}

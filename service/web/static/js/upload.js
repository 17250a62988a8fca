/** Getting a file to the service: one POST for a small one, resumable tus 1.0.0 for a large one. */

import { Problem, asset, authorisation, renewKey, request } from "./api.js";

const TUS = { "Tus-Resumable": "1.0.0" };
const SMALL_BYTES = 32 * 2 ** 20;
const CHUNK_BYTES = 8 * 2 ** 20;
const PAUSE_MS = [500, 1000, 2000, 4000, 8000];

/** Upload `file`; `onProgress(fraction)` is told of bytes sent. Resolves to the asset, throws a Problem. */
export function upload(file, { onProgress = () => {}, signal } = {}) {
  if (!file.size) return Promise.reject(empty(file));
  return file.size <= SMALL_BYTES ? whole(file, onProgress, signal) : resumable(file, onProgress, signal);
}

const empty = (file) =>
  new Problem({ detail: `“${file.name}” is empty.`, field: "file", code: "unreadable-media", remedy: "Choose another file." });

async function whole(file, onProgress, signal) {
  const body = new FormData();
  body.append("file", file, file.name);
  const answer = await send({ verb: "POST", path: "/v1/assets", body, onProgress, signal });
  return JSON.parse(answer.responseText);
}

/** XMLHttpRequest, since fetch does not tell the progress of an upload. */
function send({ verb, path, body, headers = {}, onProgress, signal }) {
  const auth = authorisation();
  return new Promise((resolve, reject) => {
    const xhr = new XMLHttpRequest();
    xhr.open(verb, path);
    for (const [name, value] of Object.entries({ ...auth, ...headers })) xhr.setRequestHeader(name, value);
    xhr.upload.onprogress = (event) => event.lengthComputable && onProgress(event.loaded / event.total);
    xhr.onload = () => (xhr.status < 300 ? resolve(xhr) : reject(refusal(xhr)));
    xhr.onerror = () => reject(broken());
    xhr.onabort = () => reject(new DOMException("Upload stopped", "AbortError"));
    signal?.addEventListener("abort", () => xhr.abort(), { once: true });
    xhr.send(body);
  }).catch(async (error) => {
    if (error.status !== 401) throw error;
    await renewKey(auth.Authorization?.slice("Bearer ".length));
    return send({ verb, path, body, headers, onProgress, signal });
  });
}

const broken = () =>
  new Problem({ detail: "The connection broke.", code: "offline", field: "file", remedy: "Try again; a large file goes on where it stopped." });

function refusal(xhr) {
  try {
    return new Problem({ field: "file", ...JSON.parse(xhr.responseText), status: xhr.status });
  } catch {
    return new Problem({ detail: `The service answered ${xhr.status}.`, status: xhr.status, field: "file" });
  }
}

// -- tus ------------------------------------------------------------------------------------------------------------

const memory = (file) => `impasto.upload:${file.name}:${file.size}:${file.lastModified}`;

async function resumable(file, onProgress, signal) {
  const place = await resume(file, signal) ?? (await create(file, signal));
  let { offset } = place;
  for (let failures = 0; ; ) {
    try {
      const answer = await sendChunk(file, place.path, offset, onProgress, signal);
      offset = Number(answer.getResponseHeader("Upload-Offset"));
      failures = 0;
      if (offset >= file.size) return await finished(file, place.path, answer);
    } catch (error) {
      if (error.code !== "offline" || failures >= PAUSE_MS.length) throw forgetting(file, error);
      await new Promise((done) => setTimeout(done, PAUSE_MS[failures++]));
      offset = (await offsetAt(place.path, signal)) ?? offset;
    }
  }
}

/** A refused upload must not be resumed; one that was only interrupted must. */
function forgetting(file, error) {
  if (error.status) localStorage.removeItem(memory(file));
  return error;
}

function sendChunk(file, path, offset, onProgress, signal) {
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

async function create(file, signal) {
  const name = btoa(String.fromCharCode(...new TextEncoder().encode(file.name)));
  const headers = { ...TUS, "Upload-Length": String(file.size), "Upload-Metadata": `filename ${name}` };
  const response = await request("/v1/uploads", { method: "POST", headers, signal });
  const path = new URL(response.headers.get("Location"), location.href).pathname;
  localStorage.setItem(memory(file), path);
  return { path, offset: 0 };
}

async function resume(file, signal) {
  const path = localStorage.getItem(memory(file));
  const offset = path && (await offsetAt(path, signal));
  return typeof offset === "number" && offset < file.size ? { path, offset } : null;
}

/** Bytes the service has, or null if it does not know the upload. */
async function offsetAt(path, signal) {
  try {
    return Number((await request(path, { method: "HEAD", headers: TUS, signal })).headers.get("Upload-Offset"));
  } catch (error) {
    if (error.name === "AbortError") throw error;
    return null;
  }
}

async function finished(file, path, answer) {
  localStorage.removeItem(memory(file));
  const id = answer.getResponseHeader("Impasto-Asset");
  if (!id) throw new Problem({ detail: "The upload has no asset.", field: "file", remedy: "Upload the file again." });
  return asset(id);
}

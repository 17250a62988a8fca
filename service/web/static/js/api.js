/** The service's HTTP API as functions. Every fault is a `Problem` (RFC 9457) with a field and a remedy. */

const KEY = "impasto.key";

/** What went wrong, why, and what to do: `field` is the dotted path of the input that caused it, or empty. */
export class Problem extends Error {
  constructor({ title = "", detail = "", code = "", field = "", value = null, remedy = "", status = 0 }) {
    super(detail || title || "Something went wrong.");
    Object.assign(this, { title, code, field: field || "", value, remedy: remedy || "", status });
  }
}

const offline = () =>
  new Problem({
    title: "No answer",
    detail: "The service does not answer.",
    code: "offline",
    remedy: "Check that it is running and that you are connected; then try again.",
  });

/** A response that is not a success, as a `Problem`. */
export async function problemOf(response) {
  const body = await response.json().catch(() => ({}));
  const detail = typeof body.detail === "string" ? body.detail : `The service answered ${response.status}.`;
  return new Problem({ ...body, detail, status: response.status });
}

const key = () => sessionStorage.getItem(KEY);
/** Headers that every request carries. */
export const authorisation = () => (key() ? { Authorization: `Bearer ${key()}` } : {});

let prompt = null;
let asking = null;
/** Install what asks the user for an API key; it is called only when the service answers 401. */
export function onKeyNeeded(ask) {
  prompt = ask;
}

/** Ask once, however many requests were refused meanwhile. */
export function renewKey(refused) {
  if (key() && key() !== refused) return Promise.resolve();
  asking ??= prompt(Boolean(refused))
    .then((given) => sessionStorage.setItem(KEY, given))
    .finally(() => (asking = null));
  return asking;
}

/** Fetch with the key, asking for one on 401. Resolves to a successful Response, else throws a Problem. */
export async function request(path, { headers = {}, ...options } = {}) {
  const used = key();
  const response = await fetch(path, { ...options, headers: { ...authorisation(), ...headers } }).catch((error) => {
    throw error.name === "AbortError" ? error : offline();
  });
  if (response.status === 401 && prompt) {
    await renewKey(used);
    return request(path, { headers, ...options });
  }
  if (!response.ok) throw await problemOf(response);
  return response;
}

const get = async (path, signal) => (await request(path, { signal })).json();

function post(path, body, options = {}) {
  const headers = { "Content-Type": "application/json", ...options.headers };
  return request(path, { ...options, method: "POST", headers, body: JSON.stringify(body) });
}

const url = (strings, ...values) => String.raw({ raw: strings }, ...values.map(encodeURIComponent));

export const methods = async () => (await get("/v1/methods")).items;
export const asset = (id) => get(url`/v1/assets/${id}`);
export const job = (id, signal) => get(url`/v1/jobs/${id}`, signal);
export const jobs = (limit, cursor = "") => get(url`/v1/jobs?limit=${limit}` + (cursor && url`&cursor=${cursor}`));
export const forget = (id) => request(url`/v1/jobs/${id}`, { method: "DELETE" });

/** `verb` is cancel, pause, resume or retry; resolves to the job as it stands after. */
export const act = async (id, verb) => (await request(url`/v1/jobs/${id}/${verb}`, { method: "POST" })).json();

/** Submit a job; the same `token` twice is the same job. */
export const submit = async (body, token) => (await post("/v1/jobs", body, { headers: { "Idempotency-Key": token } })).json();

/** One stylised frame, a PNG blob. */
export const preview = async (body, signal) => (await post("/v1/previews", body, { signal })).blob();

/** A random token; `crypto.randomUUID` exists in secure contexts only. */
export function token() {
  return Array.from(crypto.getRandomValues(new Uint8Array(16)), (byte) => byte.toString(16).padStart(2, "0")).join("");
}

export const paths = {
  content: (assetId) => url`/v1/assets/${assetId}/content`,
  frame: (assetId, index, side) => url`/v1/assets/${assetId}/frame?index=${index}&max_side_px=${side}`,
  result: (jobId) => url`/v1/jobs/${jobId}/result`,
  file: (jobId, name) => url`/v1/jobs/${jobId}/files/${name}`,
  events: (jobId) => url`/v1/jobs/${jobId}/events`,
};

/** The bytes at `path` as an object URL, which the caller revokes. */
export async function objectUrl(path, signal) {
  return URL.createObjectURL(await (await request(path, { signal })).blob());
}

/**
 * An address that media elements can load: the path itself, or an object URL where a key is needed, for elements send
 * no Authorization header.
 */
export const mediaUrl = (path) => (key() ? objectUrl(path) : Promise.resolve(path));

/** Save a file of the service under the name that the service gives it. */
export async function download(path) {
  const link = document.createElement("a");
  link.href = `${path}?download=true`;
  link.download = "";
  if (key()) await fetched(link);
  link.click();
}

/** A link cannot send the key: let it point at the bytes instead. */
async function fetched(link) {
  const response = await request(link.href);
  link.download = /filename="([^"]+)"/.exec(response.headers.get("Content-Disposition"))?.[1] ?? "";
  link.href = URL.createObjectURL(await response.blob());
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

/** Requests to the service, with the key of the user. Every failure is a `Problem` (RFC 9457) with a field and a remedy. */

import { under } from "./base";

const KEY = "impasto.key";

/** Fields of a problem+json answer. */
export interface ProblemFields {
  title?: string;
  detail?: string;
  code?: string;
  field?: string;
  value?: unknown;
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

/** The API key of this tab, if one was needed. */
export const key = (): string | null => sessionStorage.getItem(KEY);

/** Headers that every request carries. */
export const authorisation = (): Record<string, string> => (key() ? { Authorization: `Bearer ${key()}` } : {});

/** `signIn`: the address where users sign in; empty: nowhere. */
type AskForKey = (refused: boolean, signIn: string) => Promise<string>;
let prompt: AskForKey | null = null;
let asking: Promise<void> | null = null;

/** Install what asks the user for an API key; it is called only when the service answers 401. */
export function onKeyNeeded(ask: AskForKey): void {
  prompt = ask;
}

/** Ask once, however many requests were refused meanwhile. `refused`: the key that the service did not accept. */
export function renewKey(refused: string | null | undefined, signIn = ""): Promise<void> {
  if ((key() && key() !== refused) || !prompt) return Promise.resolve();
  asking ??= prompt(Boolean(refused), signIn)
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
export async function request(target: string | Request, options: RequestOptions = {}): Promise<Response> {
  const used = key();
  const response = await fetch(attempt(target, options)).catch((error) => {
    throw isAbort(error) ? error : offline();
  });
  if (response.status === 401 && prompt) {
    await renewKey(used, signInAt(response));
    return request(target, options);
  }
  if (!response.ok) throw await problemOf(response);
  return response;
}

/** Where users sign in, as a refusal says; empty: nowhere. */
function signInAt(response: Response): string {
  const path = /sign_in="([^"]+)"/.exec(response.headers.get("WWW-Authenticate") ?? "")?.[1];
  const { pathname, search, hash } = globalThis.location;
  return path ? `${under(path)}?next=${encodeURIComponent(pathname + search + hash)}` : "";
}

/** A request that can be sent, with the present key; `target` can be sent again. */
function attempt(target: string | Request, { headers = {}, ...options }: RequestOptions): Request {
  if (typeof target === "string")
    return new Request(under(target), { ...options, headers: { ...authorisation(), ...headers } });
  const copy = target.clone();
  for (const [name, value] of Object.entries(authorisation())) copy.headers.set(name, value);
  return copy;
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

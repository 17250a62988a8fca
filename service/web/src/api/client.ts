/** Typed requests: `client` has the types of every path, parameter, body and answer of the service's OpenAPI document. */

import createClient from "openapi-fetch";
import type { paths } from "../../types/api";
import { base } from "./base";
import { request } from "./http";

/** Requests carry the user's key. Every answer with an error status is thrown as a `Problem`. */
export const client = createClient<paths>({ baseUrl: (globalThis.location?.origin ?? "") + base, fetch: request });

/** The body of an answer. */
export async function bodyOf<Body>(answer: Promise<{ data?: Body }>): Promise<NonNullable<Body>> {
  return (await answer).data as NonNullable<Body>;
}

/** The bytes of an answer to a request with `parseAs: "stream"`. */
export async function blobOf(answer: Promise<{ response: Response }>): Promise<Blob> {
  return (await answer).response.blob();
}

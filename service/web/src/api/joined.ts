/** Waiting for the film of several shots to be joined into one file. */

import { asProblem, get, request } from "./http";

const EVERY_MS = 1500;

/**
 * Begin the join of a film, if it is not made, and wait for its end. `film`: address of what tells how far it is, `content`
 * that of the file; `onwait` is called with the fraction done.
 */
export async function joined(
  film: string,
  content: string,
  onwait: (done: number) => void,
  signal?: AbortSignal,
): Promise<void> {
  for (;;) {
    try {
      await request(content, { headers: { Range: "bytes=0-0" }, signal: signal ?? null });
      return;
    } catch (error) {
      const { status, field } = asProblem(error);
      if (status !== 409 || field !== "shots") throw error;
    }
    onwait((await get<{ joined: number | null }>(film, signal)).joined ?? 0);
    await new Promise((done) => setTimeout(done, EVERY_MS));
  }
}

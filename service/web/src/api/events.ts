/** Server-Sent Events by fetch, since `EventSource` cannot send an Authorization header. */

import { Problem, paths, request } from "./api";

const PAUSE_MS = [500, 1000, 2000, 5000];

export interface ServerEvent {
  id: string;
  type: string;
  data: string;
}

/** Cut complete messages off the front of `text`: [messages, rest]. */
export function parse(text: string): [ServerEvent[], string] {
  const blocks = text.replaceAll("\r\n", "\n").split("\n\n");
  const rest = blocks.pop() ?? "";
  return [blocks.map(message).filter((event) => event.data), rest];
}

function message(block: string): ServerEvent {
  const found: ServerEvent = { id: "", type: "message", data: "" };
  for (const line of block.split("\n")) {
    const [, name, value = ""] = /^([^:]*):? ?(.*)$/.exec(line) ?? [];
    if (name === "data") found.data += (found.data && "\n") + value;
    else if (name === "id") found.id = value;
    else if (name === "event") found.type = value;
  }
  return found;
}

const sleep = (ms: number): Promise<void> => new Promise((done) => setTimeout(done, ms));

/**
 * Call `listen(message)` for every event of a job until `signal` aborts, reconnecting where the stream breaks.
 * `listen(null)` means that the stream is (again) open: read the job anew, since events may have been missed.
 */
export async function follow(
  jobId: string,
  listen: (event: ServerEvent | null) => void,
  signal: AbortSignal,
): Promise<void> {
  const last = { id: "" };
  for (let failures = 0; !signal.aborted; failures++) {
    const heard = (event: ServerEvent | null) => {
      if (event) failures = 0;
      listen(event);
    };
    try {
      await readStream(jobId, last, heard, signal);
    } catch (error) {
      if (signal.aborted || (error instanceof Problem && error.status === 404)) return;
    }
    await sleep(PAUSE_MS[Math.min(failures, PAUSE_MS.length - 1)] ?? 5000);
  }
}

async function readStream(
  jobId: string,
  last: { id: string },
  listen: (event: ServerEvent | null) => void,
  signal: AbortSignal,
): Promise<void> {
  const headers = { Accept: "text/event-stream", ...(last.id && { "Last-Event-ID": last.id }) };
  const response = await request(paths.events(jobId), { headers, signal, cache: "no-store" });
  if (!response.body) return;
  listen(null);
  const reader = response.body.getReader();
  const decoder = new TextDecoder();
  for (let text = "", part = await reader.read(); !part.done; part = await reader.read()) {
    const [messages, rest] = parse(text + decoder.decode(part.value, { stream: true }));
    text = rest;
    for (const event of messages) {
      last.id = event.id || last.id;
      listen(event);
    }
  }
}

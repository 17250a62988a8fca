/** Server-Sent Events by fetch, for `EventSource` cannot send an Authorization header. */

import { paths, request } from "./api.js";

const PAUSE_MS = [500, 1000, 2000, 5000];

/** Cut complete messages off the front of `text`: [messages, rest]. */
export function parse(text) {
  const blocks = text.replaceAll("\r\n", "\n").split("\n\n");
  const rest = blocks.pop();
  return [blocks.map(message).filter((m) => m.data), rest];
}

function message(block) {
  const found = { id: "", type: "message", data: "" };
  for (const line of block.split("\n")) {
    const [, name, value] = /^([^:]*):? ?(.*)$/.exec(line);
    if (name === "data") found.data += (found.data && "\n") + value;
    else if (name === "id") found.id = value;
    else if (name === "event") found.type = value;
  }
  return found;
}

const sleep = (ms) => new Promise((done) => setTimeout(done, ms));

/**
 * Call `listen(message)` for every event of a job until `signal` aborts, reconnecting where the stream breaks.
 * `listen` with null says that the stream is (again) open: read the job anew, for something may have been missed.
 */
export async function follow(jobId, listen, signal) {
  const last = { id: "" };
  for (let failures = 0; !signal.aborted; failures++) {
    try {
      await stream(jobId, last, (m) => ((failures = 0), listen(m)), signal);
    } catch (error) {
      if (signal.aborted || error.status === 404) return;
    }
    await sleep(PAUSE_MS[Math.min(failures, PAUSE_MS.length - 1)]);
  }
}

async function stream(jobId, last, listen, signal) {
  const headers = { Accept: "text/event-stream", ...(last.id && { "Last-Event-ID": last.id }) };
  const response = await request(paths.events(jobId), { headers, signal, cache: "no-store" });
  if (!response.body) return;
  listen(null);
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  for (let text = "", part = await reader.read(); !part.done; part = await reader.read()) {
    const [messages, rest] = parse(text + part.value);
    text = rest;
    for (const m of messages) {
      last.id = m.id || last.id;
      listen(m);
    }
  }
}

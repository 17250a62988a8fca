/** A job as text that makes it again: with curl, in Python, or by the command. */

import { outputOf } from "../api/formats";
import type { Job, Output } from "../api/schemas";

/** The body of POST /v1/jobs. */
function body(job: Job): Record<string, unknown> {
  const { method, inputs, params, seed = 0, frames, output, name = "" } = job.request;
  return { method, inputs, params, seed, ...(frames && { frames }), ...(output && { output }), ...(name && { name }) };
}

/** Text as one word of a POSIX shell. */
const quoted = (text: string): string => (/^[\w./:=@-]+$/.test(text) ? text : `'${text.replaceAll("'", "'\\''")}'`);

export const curlLine = (job: Job, origin: string): string =>
  `curl -sS -H 'Content-Type: application/json' -d ${quoted(JSON.stringify(body(job)))} ${quoted(`${origin}/v1/jobs`)}`;

export function pythonLine(job: Job, origin: string): string {
  const { method, inputs, params, seed = 0, frames, output } = job.request;
  const piece = frames ? `, frames=(${frames.join(", ")})` : "";
  const wanted = output?.format && output.format !== "mp4" ? `, output=${literal({ ...output })}` : "";
  return [
    "import json",
    "from impasto import Client",
    "",
    `with Client(${JSON.stringify(origin)}) as impasto:`,
    `    job = impasto.submit(${JSON.stringify(method)}, ${literal(inputs)}, ${literal(params)}, seed=${seed}${piece}${wanted})`,
    '    impasto.wait(job["id"])',
    `    impasto.download(job["id"], "film${outputOf(output?.format).suffix}")`,
  ].join("\n");
}

/** Whether the film is a zip whose extension does not tell the format of its pictures. */
const isArchive = (output: Output | undefined): boolean =>
  output?.format !== "png" && outputOf(output?.format).suffix === ".zip";

/** A JSON value as a Python expression. */
const literal = (value: unknown): string => `json.loads(${JSON.stringify(JSON.stringify(value))})`;

/** `impasto render` with placeholders for the files, which the command reads from the user's disk. */
export function commandLine(job: Job): string {
  const { method, inputs, params, seed = 0, frames, output } = job.request;
  const files = Object.keys(inputs).filter((name) => name !== "video");
  return [
    "impasto render VIDEO",
    `-o film${outputOf(output?.format).suffix}`,
    ...(isArchive(output) ? [`--format ${output?.format}`] : []),
    ...(output?.profile ? [`--profile ${output.profile}`] : []),
    ...(output?.alpha && output.alpha !== "auto" ? [`--alpha ${output.alpha}`] : []),
    `--method ${method}`,
    ...files.map((name) => `--input ${name}=${name.toUpperCase()}`),
    ...Object.entries(params).map(
      ([name, value]) => `--param ${quoted(`${name}=${typeof value === "string" ? value : JSON.stringify(value)}`)}`,
    ),
    ...(seed ? [`--seed ${seed}`] : []),
    ...(frames ? [`--frames ${frames.join(":")}`] : []),
  ].join(" ");
}

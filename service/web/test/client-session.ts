/**
 * A whole job with the generated types and openapi-fetch: upload, submit, events, list, result. The types are checked by
 * `npm run check`; tests/service/test_generated_typescript_client.py runs it with Node.js against a real service.
 *
 *     node test/client-session.ts ADDRESS KEY VIDEO      prints what happened as one JSON object
 */

import createClient from "openapi-fetch";
import type { paths } from "../types/api";

interface Surroundings {
  argv: string[];
  getBuiltinModule(name: "fs"): { openAsBlob(path: string): Promise<Blob> };
}

const { argv, getBuiltinModule } = (globalThis as unknown as { process: Surroundings }).process;
const [, , baseUrl = "", key = "", video = ""] = argv;
const client = createClient<paths>({ baseUrl, headers: { Authorization: `Bearer ${key}` } });

const form = new FormData();
form.set("file", await getBuiltinModule("fs").openAsBlob(video), "clip.mp4");
const upload = await client.POST("/v1/assets", { body: { file: "" }, bodySerializer: () => form });
if (!upload.data) throw new Error(upload.error.detail);

const body = { method: "abstraction", inputs: { video: upload.data.id } };
const submitted = await client.POST("/v1/jobs", { body });
if (!submitted.data) throw new Error(submitted.error.detail);
const path = { job_id: submitted.data.id };

const stream = await client.GET("/v1/jobs/{job_id}/events", { params: { path }, parseAs: "stream" });
const messages = (await stream.response.text()).split("\n\n").filter((message) => message.startsWith("id:"));

const listed = await client.GET("/v1/jobs", { params: { query: { state: "succeeded" } } });
const result = await client.GET("/v1/jobs/{job_id}/result", { params: { path }, parseAs: "stream" });
const refused = await client.POST("/v1/jobs", { body: { method: "no such method", inputs: {} } });

console.log(
  JSON.stringify({
    job: submitted.data.id,
    width: upload.data.info.width,
    lastEvent: messages.at(-1) ?? "",
    listed: listed.data?.items.map((job) => job.id),
    resultBytes: (await result.response.arrayBuffer()).byteLength,
    refusedField: refused.error?.field,
  }),
);

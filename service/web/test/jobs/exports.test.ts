import { expect, test } from "vitest";
import type { Job } from "../../src/api/schemas";
import { exportsHint, exportsOf } from "../../src/jobs/exports";
import { ownLabels } from "../../src/jobs/job-list";
import { commandLine, pythonLine } from "../../src/jobs/recipes";

const job = (format: "mp4" | "webm" | "png" | "gif"): Job =>
  ({
    request: { method: "abstraction", inputs: { video: "ast_1" }, params: {}, output: { format } },
  }) as unknown as Job;

test("a film is exported in every format but its own, and a GIF in none", () => {
  expect(exportsOf("mp4")).toEqual(["webm", "png", "gif"]);
  expect(exportsOf("png")).toEqual(["mp4", "webm", "gif"]);
  expect(exportsOf("gif")).toEqual([]);
});

test("the page says whether exported PNG frames are the painted ones", () => {
  expect(exportsHint("mp4")).toContain("decoded frames, which differ from the painted ones");
  expect(exportsHint("webm")).toContain("WebM");
  expect(exportsHint("png")).toBe("Exports are converted from the painted frames.");
});

test("recipes name a file of the job's format, and ask for that format", () => {
  expect(commandLine(job("gif"))).toContain("-o film.gif");
  expect(commandLine(job("png"))).toContain("-o film.zip");
  expect(pythonLine(job("webm"), "http://here")).toContain('"film.webm"');
  expect(pythonLine(job("webm"), "http://here")).toContain('output=json.loads("{\\"format\\":\\"webm\\"}")');
  expect(pythonLine(job("mp4"), "http://here")).not.toContain("output=");
});

test("works are found by name, method and label; labels of the studio are not shown", () => {
  const labels = { project: "prj_1", shot: "s1", scene: "12", draft: "" };
  const made = { request: { ...job("mp4").request, name: "Swan lake", labels } } as unknown as Job;
  expect(ownLabels(made)).toEqual(["scene: 12", "draft"]);
});

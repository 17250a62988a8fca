import { expect, test } from "vitest";
import { outputs } from "../../src/api/formats";
import type { Job, OutputName } from "../../src/api/schemas";
import { exportsHint, exportsOf } from "../../src/jobs/exports";
import { ownLabels } from "../../src/jobs/job-list";
import { commandLine, pythonLine } from "../../src/jobs/recipes";

const job = (format: OutputName, profile = ""): Job =>
  ({
    request: { method: "abstraction", inputs: { video: "ast_1" }, params: {}, output: { format, profile } },
  }) as unknown as Job;

test("a film is exported in every format but its own, and a GIF in none", () => {
  expect(exportsOf("mp4")).toEqual(outputs.map(({ name }) => name).filter((name) => name !== "mp4"));
  expect(exportsOf("png")).toContain("mov");
  expect(exportsOf("png")).not.toContain("png");
  expect(exportsOf("gif")).toEqual([]);
});

test("the page says whether exported PNG frames are the painted ones", () => {
  expect(exportsHint("mp4")).toContain("decoded frames, which differ from the painted ones");
  expect(exportsHint("webm")).toContain("WebM");
  expect(exportsHint("png")).toBe("Exports are converted from the painted frames.");
});

test("recipes name a file of the job's format, and ask for that format", () => {
  expect(commandLine(job("gif"))).toContain("-o film.gif");
  expect(commandLine(job("png"))).toContain("-o film.zip --method");
  expect(commandLine(job("exr"))).toContain("-o film.zip --format exr");
  expect(commandLine(job("mov", "4444"))).toContain("-o film.mov --profile 4444");
  expect(pythonLine(job("webm"), "http://here")).toContain('"film.webm"');
  expect(pythonLine(job("webm"), "http://here")).toContain('output=json.loads("{\\"format\\":\\"webm\\",');
  expect(pythonLine(job("mp4"), "http://here")).not.toContain("output=");
});

test("works are found by name, method and label; labels of the studio are not shown", () => {
  const labels = { project: "prj_1", shot: "s1", scene: "12", draft: "" };
  const made = { request: { ...job("mp4").request, name: "Swan lake", labels } } as unknown as Job;
  expect(ownLabels(made)).toEqual(["scene: 12", "draft"]);
});

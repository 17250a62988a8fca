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

test("a film is exported in every encoding but its own, and a GIF in none", () => {
  const all = outputs.flatMap(({ name, profiles }) => profiles.map((profile) => `${name} ${profile.name}`));
  const offered = (format: OutputName, profile = "") =>
    exportsOf(job(format, profile).request.output).map((one) => `${one.format} ${one.profile}`);
  expect(offered("mp4")).toEqual(all.filter((name) => name !== "mp4 h264"));
  expect(offered("mov", "422hq")).toContain("mov 4444");
  expect(offered("mov", "422hq")).not.toContain("mov 422hq");
  expect(offered("png", "16")).toContain("png 8");
  expect(offered("gif")).toEqual([]);
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
  const labels = { project: "prj_1", shot: "s1", content: "3f-1", scene: "12", draft: "" };
  const made = { request: { ...job("mp4").request, name: "Swan lake", labels } } as unknown as Job;
  expect(ownLabels(made)).toEqual(["scene: 12", "draft"]);
});

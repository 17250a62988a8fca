import { beforeEach, expect, test, vi } from "vitest";
import type { Job } from "../../src/api/schemas";

const { job, follow } = vi.hoisted(() => ({ job: vi.fn(), follow: vi.fn() }));
vi.mock("../../src/api/api", async () => ({ ...(await vi.importActual("../../src/api/http")), job }));
vi.mock("../../src/api/events", () => ({ follow }));

vi.resetModules(); // another test file of this process may have loaded the module without the mocks
const { watchJob } = await import("../../src/jobs/watch-job");
const { Problem } = await import("../../src/api/http");

const DONE = { id: "job_1", state: "succeeded" } as Job;

beforeEach(() => {
  vi.resetAllMocks();
  follow.mockImplementation(async (_id: string, listen: (event: null) => void) => listen(null));
});

test("a job that cannot be read at first is followed when the service answers again", async () => {
  job.mockRejectedValueOnce(new Problem({ code: "offline" })).mockResolvedValue(DONE);
  const onmissing = vi.fn();
  const seen = await new Promise((onchange) =>
    watchJob("job_1", { onchange, onmissing }, new AbortController().signal),
  );
  expect(seen).toBe(DONE);
  expect(onmissing).toHaveBeenCalledExactlyOnceWith(expect.objectContaining({ code: "offline" }), true);
});

test("a job that does not exist is not asked for again", async () => {
  job.mockRejectedValue(new Problem({ status: 404 }));
  const onmissing = vi.fn();
  await watchJob("job_1", { onchange: vi.fn(), onmissing }, new AbortController().signal);
  expect(onmissing).toHaveBeenCalledExactlyOnceWith(expect.objectContaining({ status: 404 }), false);
  expect(follow).not.toHaveBeenCalled();
});

import { expect, test } from "vitest";
import { queueText } from "../../src/jobs/progress";

test("the queue sentence states the position, and the expected wait if it is known", () => {
  expect(queueText(null)).toBe("Queued");
  expect(queueText({ jobs_ahead: 0, seconds: 0, more: false })).toBe("Queued, next in line");
  expect(queueText({ jobs_ahead: 1, seconds: null, more: false })).toBe("Queued, 1 job ahead");
  expect(queueText({ jobs_ahead: 2, seconds: 250, more: false })).toBe("Queued, 2 jobs ahead, about 4 min");
  expect(queueText({ jobs_ahead: 1000, seconds: 9000, more: true })).toBe("Queued, more than 1000 jobs ahead");
  expect(queueText({ jobs_ahead: 2, seconds: 10, more: false })).toBe("Queued, 2 jobs ahead, less than a minute");
});

import { expect, test } from "vitest";
import { queueText, steadyLeft } from "../../src/jobs/progress";

test("the time left runs down with the clock, and follows estimates without jumping", () => {
  expect(steadyLeft("job", 30, 0)).toBe(30);
  expect(steadyLeft("job", 180, 0.5)).toBeLessThan(35);
  let [left, at] = [0, 0.5];
  for (const eta of [180, 60, 170, 60, 55, 50]) {
    const before = left || 33;
    at += 1;
    left = steadyLeft("job", eta, at);
    expect(Math.abs(left - before)).toBeLessThan(9);
  }
  for (let k = 0; k < 100; k++) left = steadyLeft("job", 200 - k, ++at);
  expect(left).toBeGreaterThan(99);
});

test("the queue sentence states the position, and the expected wait if it is known", () => {
  expect(queueText(null)).toBe("Queued");
  expect(queueText({ jobs_ahead: 0, seconds: 0, more: false })).toBe("Queued, next in line");
  expect(queueText({ jobs_ahead: 1, seconds: null, more: false })).toBe("Queued, 1 job ahead");
  expect(queueText({ jobs_ahead: 2, seconds: 250, more: false })).toBe("Queued, 2 jobs ahead, about 4 min");
  expect(queueText({ jobs_ahead: 1000, seconds: 9000, more: true })).toBe("Queued, more than 1000 jobs ahead");
  expect(queueText({ jobs_ahead: 2, seconds: 10, more: false })).toBe("Queued, 2 jobs ahead, less than a minute");
});

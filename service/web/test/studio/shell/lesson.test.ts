import { expect, test } from "vitest";
import { stepsDone } from "../../../src/studio/shell/lesson";

test("a step of the lesson counts only after those before it, and stays done", () => {
  expect(stepsDone({ painting: false, keys: 0, neighbours: 0 })).toBe(0);
  expect(stepsDone({ painting: true, keys: 0, neighbours: 7 })).toBe(1);
  expect(stepsDone({ painting: false, keys: 1, neighbours: 0 })).toBe(2);
  expect(stepsDone({ painting: false, keys: 1, neighbours: 0 }, 3)).toBe(3);
  expect(stepsDone({ painting: true, keys: 2, neighbours: 7 })).toBe(4);
});

import { describe, expect, it } from "vitest";
import { sizeSentence, smallWarning } from "../../src/live/size-sentence";

describe("sizeSentence", () => {
  it("names the full size without a reason", () => {
    expect(sizeSentence(1, { reason: "input" })).toBe("Painted at the full size of your frames.");
    expect(sizeSentence(1, { reason: "room", latency_ms: 9, deadline_ms: 33 })).toContain("full size");
  });
  it("gives the delay that was too long, and the one that is allowed", () => {
    expect(sizeSentence(0.75, { reason: "slow", latency_ms: 47.2, deadline_ms: 33.3 })).toBe(
      "Painted at 75 % of the size: larger frames took up to 47 ms, and 33 ms are allowed.",
    );
  });
  it("gives the spare time that allowed a larger size", () => {
    expect(sizeSentence(0.5, { reason: "room", latency_ms: 12, deadline_ms: 33.3 })).toContain(
      "at most 12 ms of 33 ms",
    );
  });
  it("has words for a size kept from before", () => {
    expect(sizeSentence(0.5, { reason: "input" })).toContain("50 %");
  });
});

it("a small working size is warned about, unless the frames themselves are small", () => {
  expect(smallWarning({ width: 160, height: 90, scale: 0.25 })).toContain("160 × 90 px");
  expect(smallWarning({ width: 160, height: 90, scale: 1 })).toBe("");
  expect(smallWarning({ width: 480, height: 270, scale: 0.75 })).toBe("");
});

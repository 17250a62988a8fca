import { describe, expect, it } from "vitest";
import { applies } from "../../src/forms/applies";

describe("applies", () => {
  it("holds without conditions", () => {
    expect(applies(undefined, {}, {})).toBe(true);
    expect(applies([], {}, {})).toBe(true);
  });

  it("compares values, numbers and inputs", () => {
    const when = [{ params: { renderer: ["explicit"] }, above: { ease: 0 } }, { inputs: ["design"] }];
    expect(applies(when, { renderer: "implicit", ease: 1 }, { inputs: [] })).toBe(false);
    expect(applies(when, { renderer: "explicit", ease: 0 }, { inputs: [] })).toBe(false);
    expect(applies(when, { renderer: "explicit", ease: 0.5 }, { inputs: [] })).toBe(true);
    expect(applies(when, { renderer: "implicit" }, { inputs: ["design"] })).toBe(true);
    expect(applies([{ without: ["design"] }], {}, { inputs: ["design"] })).toBe(false);
  });

  it("knows the render passes of the video", () => {
    const when = [{ params: { temporal: ["on"] }, without_passes: ["motion"] }];
    expect(applies(when, { temporal: "on" }, { passes: ["motion", "depth"] })).toBe(false);
    expect(applies(when, { temporal: "on" }, { passes: ["depth"] })).toBe(true);
    expect(applies(when, { temporal: "on" }, {})).toBe(true);
  });

  it("knows streams and pieces, and lets what is unknown pass", () => {
    expect(applies([{ way: "film" }], {}, { stream: true })).toBe(false);
    expect(applies([{ way: "film" }], {}, {})).toBe(true);
    expect(applies([{ way: "piece" }], {}, { piece: false })).toBe(false);
    expect(applies([{ inputs: ["design"] }], {}, {})).toBe(true);
  });
});

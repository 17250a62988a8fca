import { expect, test } from "vitest";
import { areas, enlarged, joined, solvedAround, solvedFrames, stamped } from "../../../src/studio/clusters/label-edits";
import { decodeLabels, encodeLabels } from "../../../src/studio/clusters/label-png";

const map = (width: number, height: number, label = 0) => ({
  width,
  height,
  labels: new Uint16Array(width * height).fill(label),
});

test("a label map survives encoding as a PNG of 16 bit", async () => {
  const labels = Uint16Array.from({ length: 35 }, (_, i) => (i * 7919) % 65536);
  const png = new Uint8Array(await encodeLabels({ width: 7, height: 5, labels }).arrayBuffer());
  expect(decodeLabels(png)).toEqual({ width: 7, height: 5, labels });
});

test.each([
  [854, 480],
  [343, 193],
  [1000, 777],
])("an enlarged map of %i x %i px is the same when its nearest pixels are taken", (width, height) => {
  const small = { width: 342, height: 192, labels: Uint16Array.from({ length: 342 * 192 }, (_, i) => i % 977) };
  const large = enlarged(small, { width, height });
  expect(large.labels.length).toBe(width * height);
  const back = Uint16Array.from(small.labels, (_, i) => {
    const [x, y] = [Math.floor(((i % 342) * width) / 342), Math.floor((Math.floor(i / 342) * height) / 192)];
    return large.labels[y * width + x] ?? 0;
  });
  expect(back).toEqual(small.labels);
  expect(enlarged(small, small)).toBe(small);
});

test("other files are refused", () => {
  expect(() => decodeLabels(new Uint8Array(40))).toThrow();
});

test("a stroke covers the discs along its path and changes a copy", () => {
  const before = map(40, 20, 1);
  const after = stamped(before, [[10, 10], [30, 10]], 3, 5); // biome-ignore format: a path
  expect(before.labels.every((label) => label === 1)).toBe(true);
  for (let x = 10; x < 30; x++) expect(after.labels[10 * 40 + x]).toBe(5);
  expect(after.labels[10 * 40 + 5]).toBe(1);
  expect(areas(after).map(([label]) => label)).toEqual([1, 5]);
  expect(areas(joined(after, 5, 1))).toEqual([[1, 1]]);
});

test("intervals stay within the video and count each frame once", () => {
  expect(solvedAround(2, 10)).toEqual([0, 9]);
  const corrections = [
    { frame: 3, image: "a", solve: [0, 9] as [number, number] },
    { frame: 8, image: "b", solve: [5, 10] as [number, number] },
  ];
  expect(solvedFrames(corrections, 20)).toBe(10);
  expect(solvedFrames([{ frame: 3, image: "a" }], 20)).toBe(20);
});

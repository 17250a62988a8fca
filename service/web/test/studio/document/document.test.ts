import { expect, test } from "vitest";
import * as doc from "../../../src/studio/document/document";

const base = doc.newDocument("Swan", "ast_1", "multistyle");
const layer = (): doc.Layer => ({ id: "l1", method: "multistyle" });

test("a new document has one shot of one layer over the video", () => {
  expect(base.shots[0]?.video).toBe("clip");
  expect(base.assets.clip?.id).toBe("ast_1");
});

test("an asset is added once, under a free name", () => {
  const [once, name] = doc.addAsset(base, "clip", { id: "ast_2" });
  expect(name).toBe("clip-2");
  expect(doc.addAsset(once, "other", { id: "ast_2" })).toEqual([once, "clip-2"]);
});

test("changing a layer leaves the original alone and shares the rest", () => {
  const changed = doc.changeLayer(base, { shot: "s1", layer: "l1" }, (one) => ({ ...one, seed: 3 }));
  expect(base.shots[0]?.layers[0]?.seed).toBeUndefined();
  expect(changed.assets).toBe(base.assets);
});

test("keys stay in the order of frames, one a frame", () => {
  const keys = [30, 10, 20, 10].reduce<doc.PaintedKey[]>(
    (list, frame, i) => doc.putAtFrame(list, { frame, image: `k${i}` }),
    [],
  );
  expect(keys.map((key) => [key.frame, key.image])).toEqual([
    [10, "k3"],
    [20, "k2"],
    [30, "k0"],
  ]);
  expect(doc.keyAt(keys, 25)?.frame).toBe(20);
  expect(doc.keyAt(keys, 3)?.frame).toBe(10);
});

test("merged regions have the tubes of both, and the second one's keys are gone", () => {
  const one: doc.Layer = {
    ...layer(),
    regions: { a: { tubes: [5, 1] }, b: { tubes: [1, 7] } },
    style_keys: [{ region: "b", frame: 0, style: "watercolor" }],
  };
  const merged = doc.mergeRegions(one, ["a", "b"]);
  expect(merged.regions).toEqual({ a: { tubes: [1, 5, 7] } });
  expect(merged.style_keys).toEqual([]);
});

test("further parts follow the first one out of a region, but for the last", () => {
  const one: doc.Layer = { id: "l1", method: "multistyle", regions: { swan: { tubes: [7, 9] }, part: { tubes: [8] } } };
  const moved = doc.moveTube(one, "swan", 7, "part");
  expect(moved.regions).toEqual({ swan: { tubes: [9] }, part: { tubes: [7, 8] } });
  expect(doc.moveTube(moved, "swan", 9, "part")).toBe(moved);
  expect(doc.moveTube(one, "swan", 8, "part")).toBe(one);
});

test("a part that is split from a region keeps its styles", () => {
  const one: doc.Layer = {
    ...layer(),
    regions: { swan: { objects: [3] } },
    style_keys: [{ region: "swan", frame: 2, style: "watercolor" }],
  };
  const split = doc.splitRegion(one, "swan", 8, "region", () => [7, 8, 9]);
  expect(split.regions).toEqual({ swan: { tubes: [7, 9] }, region: { tubes: [8] } });
  expect(split.style_keys?.map(({ region, style }) => [region, style])).toEqual([
    ["swan", "watercolor"],
    ["region", "watercolor"],
  ]);
  expect(doc.splitRegion({ ...one, regions: { swan: { tubes: [8] } } }, "swan", 8, "region", () => [])).toMatchObject({
    regions: { swan: { tubes: [8] } },
  });
});

test("moving a key replaces the key at its new frame", () => {
  const one: doc.Layer = {
    ...layer(),
    keys: [
      { frame: 1, image: "a" },
      { frame: 4, image: "b" },
    ],
  };
  expect(doc.moveKeys(one, "keys", 1, 4).keys).toEqual([{ frame: 4, image: "a" }]);
});

test("assets that nothing refers to are removed", () => {
  const [more] = doc.addAsset(base, "old", { id: "ast_9" });
  expect(doc.pruneAssets(more)).toEqual(base);
  expect(doc.pruneAssets(base)).toBe(base);
});

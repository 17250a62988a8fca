import { expect, test } from "vitest";
import type { InputSpec } from "../../../src/api/schemas";
import { applies } from "../../../src/forms/applies";
import * as doc from "../../../src/studio/document/document";

const base = doc.newDocument("Swan", "ast_1", "multistyle");

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

test("a part of a layer is put beside the others, and starts empty", () => {
  const one: doc.Layer = { id: "l1", method: "analogy", parts: { keys: [{ frame: 1, image: "a" }] } };
  expect(doc.picturesOf(one, "marks")).toEqual([]);
  const two = doc.withPart(one, "marks", doc.putAtFrame(doc.picturesOf(one, "marks"), { frame: 4, image: "b" }));
  expect(doc.picturesOf(two, "marks")).toEqual([{ frame: 4, image: "b" }]);
  expect(doc.picturesOf(two, "keys")).toBe(doc.picturesOf(one, "keys"));
});

test("assets that nothing refers to are removed", () => {
  const [more] = doc.addAsset(base, "old", { id: "ast_9" });
  expect(doc.pruneAssets(more)).toEqual(base);
  expect(doc.pruneAssets(base)).toBe(base);
});

test("a layer's inputs are its files and what is drawn in its parts, and hide what needs others", () => {
  const spec = (name: string, kind: InputSpec["kind"], part = "") => ({ name, kind, part }) as InputSpec;
  const specs = [
    spec("video", "video"),
    spec("style", "image"),
    spec("keyframes", "images", "keys.image"),
    spec("masks", "images", "keys.mask"),
    spec("design", "json", "design"),
  ];
  const layer: doc.Layer = { id: "l1", method: "m", inputs: { style: "a" } };
  expect(doc.inputsOf(layer, specs)).toEqual(["style"]);
  expect(doc.inputsOf({ ...layer, parts: { keys: [], design: {} } }, specs)).toEqual(["style"]);
  const drawn = { ...layer, parts: { keys: [{ frame: 3, image: "k3" }], design: { keys: [] } } };
  expect(doc.inputsOf(drawn, specs)).toEqual(["style", "keyframes", "design"]);
  const keyed = [{ inputs: ["keyframes"] }];
  const shown = [layer, drawn].map((one) => applies(keyed, {}, { inputs: doc.inputsOf(one, specs) }));
  expect(shown).toEqual([false, true]);
});

import fc from "fast-check";
import { expect, test } from "vitest";
import type { Design } from "../../../src/studio/document/design";
import * as doc from "../../../src/studio/document/document";
import * as looks from "../../../src/studio/document/looks";
import * as shots from "../../../src/studio/document/shots";
import { type History, record, startHistory, undo } from "../../../src/studio/document/undo";

const PARTS = { paintings: ["painting"], design: "design" };
const design: Design = {
  regions: { swan: { objects: [1] }, water: { objects: [2] } },
  styles: { mine: { width: 3 } },
  keys: [
    { region: "swan", frame: 12, style: "mine", set: { hue: 20 } },
    { region: "swan", frame: 30, style: "dots" },
  ],
};

/** A film of two shots; the first one has a painting, another input, a key and a design. */
function film(): doc.ProjectDocument {
  let one = doc.newDocument("Swan", "ast_v", "some-method");
  one = {
    ...one,
    assets: { ...one.assets, wave: { id: "ast_wave" }, lines: { id: "ast_lines" }, key: { id: "ast_key" } },
  };
  one = doc.changeLayer(one, { shot: "s1", layer: "l1" }, (layer) => ({
    ...layer,
    params: { width: 5 },
    seed: 4,
    inputs: { painting: "wave", lines: "lines" },
    parts: { design, keys: [{ frame: 3, image: "key" }] },
  }));
  return shots.addClips(one, [{ id: "ast_w", title: "w.mp4" }], "other-method");
}

const second = (one: doc.ProjectDocument) => doc.layerOf(one.shots[1], one.shots[1]?.layers[0]?.id ?? "");
const place = (one: doc.ProjectDocument) => ({ shot: "s2", layer: second(one)?.id ?? "" });

test("a look has all that is not tied to frames", () => {
  const one = film();
  const look = looks.lookOf("Mine", one.shots[0]?.layers[0] as doc.Layer, PARTS);
  expect(look).toEqual({
    title: "Mine",
    method: "some-method",
    params: { width: 5 },
    seed: 4,
    inputs: { painting: "wave" },
    styles: { mine: { width: 3 } },
    regions: { swan: { style: "mine", set: { hue: 20 } } },
  });
  expect(looks.portable({ ...look, picture: "wave" }, one)).toMatchObject({
    inputs: { painting: "ast_wave" },
    picture: "ast_wave",
  });
});

test("another shot gets the look, keeps what is drawn on it, and its regions of the same name get the style", () => {
  let one = film();
  const drawn = {
    keys: [{ frame: 7, image: "key" }],
    design: { regions: { swan: { objects: [9] } }, keys: [{ region: "sky", frame: 1 }] },
  };
  one = doc.changeLayer(one, place(one), (layer) => ({
    ...layer,
    inputs: { lines: "lines", painting: "key" },
    parts: drawn,
  }));
  const look = looks.portable(looks.lookOf("Mine", one.shots[0]?.layers[0] as doc.Layer, PARTS), one);
  const used = second(looks.useLook(one, place(one), look, PARTS, 40));
  expect(used).toMatchObject({
    method: "some-method",
    params: { width: 5 },
    seed: 4,
    inputs: { lines: "lines", painting: "wave" },
  });
  expect(used?.parts?.keys).toBe(drawn.keys);
  expect(used?.parts?.design).toEqual({
    regions: { swan: { objects: [9] } },
    styles: { mine: { width: 3 } },
    keys: [
      { region: "sky", frame: 1 },
      { region: "swan", frame: 40, style: "mine", set: { hue: 20 } },
    ],
  });
});

test("a look is the same after a file, and with other ids where it is imported", () => {
  const one = film();
  const look = {
    ...looks.portable(looks.lookOf("Mine", one.shots[0]?.layers[0] as doc.Layer, PARTS), one),
    picture: "ast_p",
  };
  const files = { ast_wave: { name: "wave.png", data: "data:,1" }, ast_p: { name: "p.png", data: "data:,2" } };
  expect(looks.assetsOf(look)).toEqual(["ast_wave", "ast_p"]);
  const read = looks.readLook(JSON.stringify(looks.fileOf(look, files)));
  expect(read.look).toEqual(look);
  expect(read.files).toEqual(files);
  expect(looks.renumbered(look, new Map([["ast_wave", "ast_new"]])).inputs).toEqual({ painting: "ast_new" });
  for (const text of ["{}", "null", '{"impasto": "look", "files": {}, "look": {"method": "x"}}'])
    expect(() => looks.readLook(text)).toThrow();
});

const name = fc.constantFrom("swan", "water", "sky");
const anyLook: fc.Arbitrary<looks.Look> = fc.record(
  {
    title: fc.string(),
    method: fc.constantFrom("some-method", "other-method"),
    params: fc.dictionary(name, fc.integer()),
    inputs: fc.dictionary(fc.constantFrom("painting"), fc.constantFrom("ast_1", "ast_2")),
    seed: fc.nat(),
    styles: fc.dictionary(name, fc.constant({ width: 1 })),
    regions: fc.dictionary(name, fc.constant({ style: "dots" })),
    picture: fc.constantFrom("ast_3", "ast_4"),
  },
  { requiredKeys: ["title", "method", "params", "inputs"] },
);

test("looks saved, used, removed on any shots in any order leave a sound document, which undo restores", () => {
  const act = fc.oneof(
    anyLook.map((look) => (one: doc.ProjectDocument) => {
      const [next, named] = looks.adopted(one, look);
      return looks.withLooks(next, [...looks.looksOf(next), named]);
    }),
    fc
      .tuple(fc.nat(), fc.nat({ max: 1 }), fc.nat({ max: 50 }))
      .map(([n, shot, first]) => (one: doc.ProjectDocument) => {
        const all = looks.looksOf(one);
        const look = all[n % Math.max(1, all.length)];
        const target = one.shots[shot];
        const layer = target?.layers[0]?.id ?? "";
        return look && target
          ? looks.useLook(one, { shot: target.id, layer }, looks.portable(look, one), PARTS, first)
          : one;
      }),
    fc.constant((one: doc.ProjectDocument) => looks.withLooks(one, looks.looksOf(one).slice(1))),
    fc.constant(doc.pruneAssets),
  );
  fc.assert(
    fc.property(fc.array(act, { maxLength: 40 }), (acts) => {
      const first = film();
      let history: History<doc.ProjectDocument> = startHistory(first);
      acts.forEach((change, i) => {
        history = record(history, "change", change(history.present), { at: i });
        const { present } = history;
        for (const look of looks.looksOf(present))
          for (const asset of [...Object.values(look.inputs), ...(look.picture ? [look.picture] : [])])
            expect(present.assets[asset]).toBeDefined();
        for (const { layers } of present.shots)
          for (const asset of layers.flatMap((layer) => Object.values(layer.inputs ?? {})))
            expect(present.assets[asset]).toBeDefined();
        expect(present.shots[0]?.layers[0]?.parts?.keys).toBe(first.shots[0]?.layers[0]?.parts?.keys);
      });
      while (history.past.length) history = undo(history);
      expect(history.present).toBe(first);
    }),
    { numRuns: 60 },
  );
});

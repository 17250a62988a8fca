import fc from "fast-check";
import { expect, test } from "vitest";
import { type Design, mergeRegions, putOnTrack, removeRegion } from "../../../src/studio/document/design";
import * as doc from "../../../src/studio/document/document";
import { DRAG_MS, type History, record, redo, rewrite, startHistory, undo } from "../../../src/studio/document/undo";

const PLACE = { shot: "s1", layer: "l1" };
type Change = (document: doc.ProjectDocument) => doc.ProjectDocument;
const onLayer =
  (change: (layer: doc.Layer) => doc.Layer): Change =>
  (document) =>
    doc.changeLayer(document, PLACE, change);

const onPart =
  <Part>(part: string, change: (value: Part | undefined) => Part): Change =>
  (document) =>
    onLayer((layer) => doc.withPart(layer, part, change(layer.parts?.[part] as Part | undefined)))(document);
const onDesign = (change: (design: Design) => Design): Change => onPart<Design>("design", (one = {}) => change(one));

const frame = fc.nat({ max: 60 });
const region = fc.constantFrom("swan", "water", "sky");
const point = fc.tuple(fc.float({ min: 0, max: 1, noNaN: true }), fc.float({ min: 0, max: 1, noNaN: true }));

/** Every kind of change that the studio makes to a document. */
const operation: fc.Arbitrary<Change> = fc.oneof(
  fc
    .tuple(fc.string(), fc.float({ noNaN: true }))
    .map(([name, value]) => onLayer((layer) => ({ ...layer, params: { ...layer.params, [name]: value } }))),
  fc.tuple(frame, fc.string()).map(
    ([at, id]): Change =>
      (document) => {
        const [next, image] = doc.addAsset(document, `key-${at}`, { id: `ast_${id}` });
        return onPart<doc.FrameImage[]>("keys", (keys) => doc.putAtFrame(keys, { frame: at, image }))(next);
      },
  ),
  frame.map((at) => onPart<doc.FrameImage[]>("keys", (keys) => doc.removeAtFrame(keys, at))),
  fc
    .tuple(region, frame, fc.string())
    .map(([name, at, style]) =>
      onDesign((one) => ({ ...one, keys: putOnTrack(one.keys, { region: name, frame: at, style }) })),
    ),
  fc.tuple(region, frame, point).map(([name, at, where]) => {
    const key = { region: name, frame: at, elements: [{ pattern: "center" as const, at: where }] };
    return onDesign((one) => ({ ...one, directions: putOnTrack(one.directions, key) }));
  }),
  fc
    .tuple(region, fc.nat(20))
    .map(([name, object]) =>
      onDesign((one) => ({ ...one, regions: { ...one.regions, [name]: { objects: [object] } } })),
    ),
  fc.constant(onDesign((one) => mergeRegions(one, ["swan", "water"]))),
  region.map((name) => onDesign((one) => removeRegion(one, name))),
  fc.constant(doc.pruneAssets),
);

test("500 random operations undone restore the document exactly, and redone repeat it", () => {
  fc.assert(
    fc.property(fc.array(operation, { minLength: 500, maxLength: 500 }), (operations) => {
      const first = doc.newDocument("Swan", "ast_1", "multistyle");
      const before = JSON.stringify(first);
      let history: History<doc.ProjectDocument> = startHistory(first);
      operations.forEach((change, i) => {
        history = record(history, `change ${i}`, change(history.present), { at: i });
      });
      const after = JSON.stringify(history.present);
      while (history.past.length) history = undo(history);
      expect(history.present).toBe(first);
      expect(JSON.stringify(history.present)).toBe(before);
      while (history.future.length) history = redo(history);
      expect(JSON.stringify(history.present)).toBe(after);
    }),
    { numRuns: 20 },
  );
});

test("steps of one group within a second are one step", () => {
  let history = startHistory(0);
  for (const [value, at] of [
    [1, 0],
    [2, 400],
    [3, 900],
    [4, 2500],
  ] as const) {
    history = record(history, "slide", value, { group: "size", at });
  }
  expect(history.past.map((step) => step.after)).toEqual([3, 4]);
  expect(undo(history).present).toBe(3);
});

test("a drag that pauses is one step", () => {
  let history = startHistory(0);
  for (const [value, at] of [
    [1, 0],
    [2, 60_000],
  ] as const) {
    history = record(history, "drag", value, { group: "drag-1", at, within: DRAG_MS });
  }
  expect(undo(history).present).toBe(0);
});

test("a new step ends the redo list, an equal state is no step", () => {
  const history = undo(record(record(startHistory("a"), "b", "b"), "c", "c"));
  expect(record(history, "same", history.present)).toBe(history);
  expect(record(history, "d", "d").future).toEqual([]);
});

test("rewriting changes every state, and equal states stay one", () => {
  const history = record(record(startHistory("a"), "b", "b"), "c", "c");
  const written = rewrite(history, (state) => state.toUpperCase());
  expect(undo(written).present).toBe("B");
  expect(written.past[1]?.before).toBe(written.past[0]?.after);
});

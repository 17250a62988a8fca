import fc from "fast-check";
import { expect, test } from "vitest";
import * as doc from "../../../src/studio/document/document";
import * as shots from "../../../src/studio/document/shots";
import { type History, record, redo, startHistory, undo } from "../../../src/studio/document/undo";

const LENGTH = 100;
const first = doc.newDocument("Bikes", "ast_1", "abstraction");

type Change = (document: doc.ProjectDocument) => doc.ProjectDocument;
const frame = fc.nat({ max: LENGTH + 20 });

/** A change of the shot whose number is drawn, counted modulo the number of shots. */
const ofShot = (number: number, change: (document: doc.ProjectDocument, id: string) => doc.ProjectDocument): Change => {
  return (document) => change(document, document.shots[number % document.shots.length]?.id ?? "");
};

/** Every kind of change that the film strip makes. */
const operation: fc.Arbitrary<Change> = fc.oneof(
  fc.array(fc.nat({ max: 9 }), { minLength: 1, maxLength: 3 }).map(
    (ids): Change =>
      (one) =>
        shots.addClips(
          one,
          ids.map((id) => ({ id: `ast_${id}`, title: `clip ${id}.mp4` })),
          "abstraction",
        ),
  ),
  fc
    .tuple(fc.nat(), fc.array(frame, { maxLength: 4 }))
    .map(([n, at]) => ofShot(n, (one, id) => shots.cutShot(one, id, at, LENGTH))),
  fc.nat().map((n) => ofShot(n, shots.duplicateShot)),
  fc.nat().map((n) => ofShot(n, shots.removeShot)),
  fc
    .tuple(fc.nat(), fc.integer({ min: -3, max: 30 }))
    .map(([n, to]) => ofShot(n, (one, id) => shots.moveShot(one, id, to))),
  fc
    .tuple(fc.nat(), fc.option(fc.tuple(frame, frame)))
    .map(([n, range]) => ofShot(n, (one, id) => shots.trimShot(one, id, range, LENGTH))),
  fc.tuple(fc.nat(), fc.string()).map(([n, name]) => ofShot(n, (one, id) => shots.renameShot(one, id, name))),
  fc.nat().map((n) =>
    ofShot(n, (one, id) => {
      const layer = doc.shotOf(one, id)?.layers[0]?.id ?? "";
      const variant = { id: `v${one.variants?.length ?? 0}-${id}`, shot: id, layer, set: {} };
      const known = (one.variants ?? []).filter((each) => each.id !== variant.id);
      return { ...one, variants: [...known, variant] };
    }),
  ),
);

function isSound(document: doc.ProjectDocument): void {
  const ids = document.shots.map(({ id }) => id);
  const layers = document.shots.flatMap((shot) => shot.layers.map(({ id }) => id));
  expect(ids.length).toBeGreaterThan(0);
  expect(new Set(ids).size).toBe(ids.length);
  expect(new Set(layers).size).toBe(layers.length);
  for (const shot of document.shots) {
    expect(document.assets[shot.video]).toBeDefined();
    const [from, end] = shots.framesOf(shot, LENGTH);
    expect(from).toBeLessThan(end);
    if (shot.range) expect(shot.range).toEqual([from, end]);
    expect((shot.name ?? "").length).toBeLessThanOrEqual(200);
  }
  for (const variant of document.variants ?? [])
    expect(doc.layerOf(doc.shotOf(document, variant.shot), variant.layer)).toBeDefined();
}

test("a film stays sound through random operations, and undo restores each state exactly", () => {
  fc.assert(
    fc.property(fc.array(operation, { minLength: 1, maxLength: 80 }), (operations) => {
      let history: History<doc.ProjectDocument> = startHistory(first);
      operations.forEach((change, i) => {
        history = record(history, `change ${i}`, change(history.present), { at: i });
        isSound(history.present);
      });
      const after = JSON.stringify(history.present);
      while (history.past.length) history = undo(history);
      expect(history.present).toBe(first);
      while (history.future.length) history = redo(history);
      expect(JSON.stringify(history.present)).toBe(after);
    }),
    { numRuns: 60 },
  );
});

test("a clip cut at its cuts is one shot for each piece, in order, without a lost frame", () => {
  const cut = shots.cutShot(first, "s1", [40, 20, 0, 100, 20], LENGTH);
  expect(cut.shots.map((shot) => shot.range)).toEqual([
    [0, 20],
    [20, 40],
    [40, 100],
  ]);
  expect(cut.shots.map((shot) => shot.id)).toEqual(["s1", "s2", "s3"]);
  expect(cut.shots.map((shot) => shot.layers[0]?.id)).toEqual(["l1", "l2", "l3"]);
  expect(shots.cutShot(first, "s1", [0, 100], LENGTH)).toBe(first);
});

test("a piece is cut within its in and out points only", () => {
  const trimmed = shots.trimShot(first, "s1", [10, 60], LENGTH);
  expect(shots.cutShot(trimmed, "s1", [5, 30, 60, 80], LENGTH).shots.map((shot) => shot.range)).toEqual([
    [10, 30],
    [30, 60],
  ]);
  expect(shots.trimShot(trimmed, "s1", [0, LENGTH], LENGTH)).toEqual(first);
});

test("a copy is edited alone", () => {
  const two = shots.duplicateShot(first, "s1");
  const id = two.shots[1]?.layers[0]?.id ?? "";
  const changed = doc.changeLayer(two, { shot: two.shots[1]?.id ?? "", layer: id }, (layer) => ({ ...layer, seed: 7 }));
  expect(changed.shots[0]).toBe(two.shots[0]);
  expect(changed.shots[1]?.layers[0]?.seed).toBe(7);
  expect(shots.changedShot(two, changed)).toBe("s2");
});

test("clips come after the shot that is shown, each under its file's name", () => {
  const two = shots.addClips(
    first,
    [
      { id: "ast_2", title: "wave.mp4" },
      { id: "ast_3", title: "sky.mov" },
    ],
    "steady",
  );
  const between = shots.addClips(two, [{ id: "ast_2", title: "wave.mp4" }], "steady", "s1");
  expect(between.shots.map((shot) => shot.name ?? "")).toEqual(["", "wave", "wave", "sky"]);
  expect(Object.values(between.assets).map(({ id }) => id)).toEqual(["ast_1", "ast_2", "ast_3"]);
});

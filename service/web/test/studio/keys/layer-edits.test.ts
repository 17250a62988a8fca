import fc from "fast-check";
import { describe, expect, it } from "vitest";
import { record, redo, startHistory, undo } from "../../../src/studio/document/undo";
import type { KeyPicture, PictureLayer } from "../../../src/studio/drawing/strokes";
import * as edits from "../../../src/studio/keys/layer-edits";

const start: KeyPicture = {
  layers: [edits.emptyLayer("frame", "Video frame", "frame:l1:4"), edits.emptyLayer("paint", "Paint", null)],
};

type Step = [what: number, layer: number, target: number];
const steps = fc.array(fc.tuple(fc.nat(8), fc.nat(30), fc.nat(30)), { maxLength: 60 });

function apply(picture: KeyPicture, [what, layer, target]: Step): KeyPicture {
  const { layers } = picture;
  const at = (index: number): PictureLayer => layers[index % layers.length] as PictureLayer;
  const { id } = at(layer);
  const where = (["above", "below", "inside"] as const)[target % 3] ?? "above";
  const moves = [
    () => edits.addLayer(picture, edits.emptyLayer(edits.freeId(picture, "paint"), "Paint", null), id),
    () => edits.removeLayer(picture, id),
    () => edits.moveLayerBy(picture, id, 1),
    () => edits.moveLayerBy(picture, id, -1),
    () => edits.moveLayer(picture, id, at(target).id, where),
    () => edits.groupLayer(picture, id),
    () => edits.ungroup(picture, id),
    () => edits.duplicateLayer(picture, id),
    () => edits.withMerged(picture, id, `ast_${target}`),
  ];
  return moves[what]?.() ?? picture;
}

/** What is wrong with the order of layers; empty: nothing. */
function faults({ layers }: KeyPicture): string[] {
  const found: string[] = [];
  if (new Set(layers.map(({ id }) => id)).size !== layers.length) found.push("two layers have one id");
  if (!layers.some(({ group }) => !group)) found.push("no layer to paint on");
  layers.forEach(({ id, parent }, index) => {
    const own = layers.findIndex((other) => other.id === parent);
    if (!parent) return;
    if (!layers[own]?.group) found.push(`${id} is in ${parent}, which is no group`);
    if (own < index) found.push(`${id} follows its group`);
    const between = layers.slice(index + 1, own);
    const inside = (one: PictureLayer): boolean =>
      one.parent === parent || layers.some((up) => up.id === one.parent && inside(up));
    if (!between.every(inside)) found.push(`another layer is between ${id} and its group`);
  });
  return found;
}

describe("layers of a key", () => {
  it("keep their order and groups under any changes", () => {
    fc.assert(
      fc.property(steps, (all) => {
        const end = all.reduce(apply, start);
        expect(faults(end)).toEqual([]);
        expect(end.layers.length).toBeLessThanOrEqual(edits.MOST_LAYERS);
      }),
      { numRuns: 300 },
    );
  });

  it("are the same after 500 changes are undone and done again", () => {
    const many = fc.array(fc.tuple(fc.nat(8), fc.nat(30), fc.nat(30)), { minLength: 500, maxLength: 500 });
    fc.assert(
      fc.property(many, (all) => {
        let history = startHistory(start);
        for (const step of all) history = record(history, "step", apply(history.present, step));
        const end = history.present;
        while (history.past.length) history = undo(history);
        expect(history.present).toBe(start);
        while (history.future.length) history = redo(history);
        expect(history.present).toBe(end);
      }),
      { numRuns: 5 },
    );
  });

  it("are moved up and down again to where they were", () => {
    const three = edits.addLayer(start, edits.emptyLayer("top", "Top", null), "paint");
    const lowered = edits.moveLayerBy(three, "top", -1);
    expect(lowered.layers.map(({ id }) => id)).toEqual(["frame", "top", "paint"]);
    expect(edits.moveLayerBy(lowered, "top", 1)).toEqual(three);
    expect(edits.moveLayer(three, "frame", "top", "above").layers.map(({ id }) => id)).toEqual([
      "paint",
      "top",
      "frame",
    ]);
  });

  it("are merged with the next one below in their group", () => {
    const grouped = edits.groupLayer(start, "paint");
    expect(edits.mergedOnto(grouped, "paint")).toBeUndefined();
    expect(edits.mergedOnto(grouped, "group")?.id).toBe("group");
    expect(edits.mergePicture(grouped, "group")?.layers.map(({ id }) => id)).toEqual(["paint", "group"]);
    expect(edits.withMerged(start, "paint", "ast_1").layers).toMatchObject([{ base: "ast_1", strokes: [] }]);
  });
});

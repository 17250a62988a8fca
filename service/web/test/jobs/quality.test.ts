import { expect, test } from "vitest";
import { notesOnFaces, rows } from "../../src/jobs/quality";

const measured = { pairs: 2, flicker: 0.714, detail: 1, structure: 0.9, samples: [], worst: [] };

test("figures are shown with two digits and their unit", () => {
  const found = rows({ ...measured, edge_width_px: 1.61, faces: 3, faces_kept: 1 });
  expect(found.map(([title, value]) => `${title} ${value}`)).toEqual([
    "Flicker 0.71",
    "Detail 1.00",
    "Structure 0.90",
    "Edge width 1.61 px",
    "Faces kept 1.00",
  ]);
  expect(found[4]?.[2]).toBe("of 3 faces found in the source");
});

test("what was not measured is left out", () => {
  expect(rows({ ...measured, flicker: null, edge_width_px: null, faces_kept: null }).map(([title]) => title)).toEqual([
    "Detail",
    "Structure",
  ]);
});

test("the page says why no faces were counted", () => {
  expect(notesOnFaces({ ...measured, faces: null })).toEqual([
    "Faces were not searched: that takes too long beside so short a render.",
  ]);
  expect(notesOnFaces({ ...measured, faces: 0 })).toEqual(["No frontal face was found in the source."]);
  expect(notesOnFaces({ ...measured, faces: 2, faces_kept: 0.5 })).toEqual([]);
});

import { expect, test, vi } from "vitest";
import { newDocument } from "../../../src/studio/document/document";
import { pictureAt } from "../../../src/studio/state/store";
import { readUnsaved, versionFollowed } from "../../../src/studio/state/unsaved";

const document = newDocument("Disc", "ast_1", "analogy");
const unsaved = { version: 3, document: { ...document, name: "Later" }, pictures: {} };

test("unsaved changes follow the version that the service stored without the page learning of it", () => {
  expect(versionFollowed({ ...unsaved, sent: document }, { version: 4, document: { ...document } })).toBe(4);
});

test("another document in the service is a conflict", () => {
  const other = { ...document, name: "Another tab's" };
  expect(versionFollowed({ ...unsaved, sent: document }, { version: 4, document: other })).toBe(3);
  expect(versionFollowed(unsaved, { version: 4, document: other })).toBe(3);
});

test("pictures that a page without films has kept belong to the first shot", () => {
  const picture = { layers: [] };
  const kept = { ...unsaved, pictures: { "l1:4:keys": picture, "l1:7": picture, "s2/l9:1:keys": picture } };
  vi.stubGlobal("localStorage", { getItem: () => JSON.stringify(kept) });
  const pictures = Object.keys(readUnsaved("prj_1")?.pictures ?? {});
  expect(pictures.map(pictureAt)).toEqual([
    { shot: "s1", layer: "l1", frame: 4, part: "keys" },
    { shot: "s1", layer: "l1", frame: 7, part: "" },
    { shot: "s2", layer: "l9", frame: 1, part: "keys" },
  ]);
  vi.unstubAllGlobals();
});

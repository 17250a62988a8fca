import { expect, test } from "vitest";
import { newDocument } from "../../../src/studio/document/document";
import { versionFollowed } from "../../../src/studio/state/unsaved";

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

/// <reference types="vite/client" />

import { expect, test } from "vitest";

const sources = Object.entries(
  import.meta.glob<string>("../src/**/*.{ts,tsx}", { query: "?raw", import: "default", eager: true }),
).map(([path, text]): [string, string] => [path.replace("../src/", ""), text]);

const found = (pattern: RegExp): string[] =>
  sources.flatMap(([file, text]) => [...text.matchAll(pattern)].map(([word]) => `${file}: ${word}`)).sort();

// The method "layers" is left out: it composites the layers of a shot, whose documents have a member of that name.
test("no page names a method: methods describe what the pages offer for them", () => {
  expect(found(/"(?:abstraction|analogy|multistyle|patches|steady)"/g)).toEqual([]);
});

/** What is left to describe as data: entries go, none comes. */
const REMAINING = [
  "studio/clusters/clusters.ts: /artefacts/labels",
  "studio/clusters/clusters.ts: /artefacts/uncertainty",
  "studio/document/document.ts: { effect:",
  "studio/previews/cuts.ts: .cut_sensitivity",
];

test("no page names an input, artefact or parameter of a method, but for those that remain", () => {
  const inputs = /"(?:style_output|style_lines|style_directions|reference|keyframes|styled|design)"/g;
  const artefacts = /\/artefacts\/\w+/g;
  const params = /(?:\.|\{ )(?:effect:|temporal\b|cut_sensitivity\b)/g;
  expect([inputs, artefacts, params].flatMap(found)).toEqual(REMAINING);
});

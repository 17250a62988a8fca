/// <reference types="vite/client" />

import { expect, test } from "vitest";

/** Path below src -> text of every source. */
const sources = new Map(
  Object.entries(
    import.meta.glob<string>("../src/**/*.{ts,tsx}", { query: "?raw", import: "default", eager: true }),
  ).map(([path, text]) => [path.replace("../src/", ""), text]),
);
/** Folders of src, each of which may import from itself and from those before it; the pages' entries are last. */
const ROOMS = [
  "api",
  "ui",
  "forms",
  "jobs",
  "studio/document",
  "studio/drawing",
  "studio/state",
  "studio/previews",
  "studio/clusters",
  "studio/films",
  "studio/keys",
  "studio/styles",
  "studio/regions",
  "studio/stage",
  "studio/tools",
  "studio/shell",
  "live",
  "ops",
  "home",
  "",
];

const roomOf = (file: string): number =>
  ROOMS.findIndex((room) => room === "" || file === room || file.startsWith(`${room}/`));

function upward([file, text]: [string, string]): string[] {
  return [...text.matchAll(/(?:from|import|import\()\s*"(\.[^"]+)"/g)]
    .map(([, path = ""]) => new URL(path, `file:///${file}`).pathname.slice(1))
    .filter((other) => !other.startsWith("css/") && !other.startsWith("types/") && roomOf(other) > roomOf(file))
    .map((other) => `${file} -> ${other}`);
}

test("no room imports from one above it", () => {
  expect(sources.size).toBeGreaterThan(100);
  expect([...sources].flatMap(upward)).toEqual([]);
});

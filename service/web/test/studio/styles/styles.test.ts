import { expect, test } from "vitest";
import { newDocument, type ProjectDocument, pruneAssets } from "../../../src/studio/document/document";
import { withLayerFiles } from "../../../src/studio/shell/layer-files";
import { paintingsOf, portableLooks, withPainting } from "../../../src/studio/styles/style-library";

const INPUTS = ["style_output", "style"];
const place = { shot: "s1", layer: "l1" };
const layerOf = (document: ProjectDocument) => document.shots[0]?.layers[0];

test("a painting of the library takes the place of the one before, and other inputs stay", () => {
  let document = newDocument("Swan", "ast_v", "analogy");
  document = withPainting(
    document,
    place,
    {
      style_output: { id: "ast_p", title: "P" },
      style: { id: "ast_s", title: "S" },
    },
    INPUTS,
  );
  expect(layerOf(document)?.inputs).toEqual({ style_output: "style_output", style: "style" });
  document = withPainting(document, place, { style_output: { id: "ast_q", title: "Q" } }, INPUTS);
  const name = layerOf(document)?.inputs?.style_output ?? "";
  expect(document.assets[name]?.id).toBe("ast_q");
  expect(layerOf(document)?.inputs).not.toHaveProperty("style");
  expect(paintingsOf(document, INPUTS)).toEqual([{ id: "ast_q", title: "Q" }]);
});

test("a style that an earlier version has saved keeps its painting when the layer has lost it, and means the same in another project", () => {
  let document = newDocument("Swan", "ast_v", "analogy");
  document = withPainting(document, place, { style_output: { id: "ast_p", title: "P" } }, INPUTS);
  const style = { title: "Mine", method: "analogy", params: { boil: 1 }, inputs: { style_output: "style_output" } };
  document = { ...withPainting(document, place, {}, INPUTS), ui: { styles: [style] as never } };
  expect(portableLooks(pruneAssets(document))).toEqual([{ ...style, inputs: { style_output: "ast_p" } }]);
});

test("a layer's own video and matte are set and taken away", () => {
  const start = newDocument("Swan", "ast_v", "abstraction");
  const both = withLayerFiles(start, place, { source: "ast_pass", matte: "ast_m" });
  expect(layerOf(both)).toMatchObject({ source: "l1-source", matte: "l1-matte" });
  expect(both.assets["l1-source"]?.id).toBe("ast_pass");
  const one = withLayerFiles(both, place, { matte: "ast_m" });
  expect(layerOf(one)).not.toHaveProperty("source");
  expect(Object.keys(pruneAssets(one).assets)).toEqual(["clip", "l1-matte"]);
});

/** What the job makes: the same form as parameters have, from a schema of our own. */

import { artefactTitle } from "./format.js";

/** Schema of the form, with the optional artefacts that a method offers. */
export const filmSchema = (artefacts) => ({
  type: "object",
  properties: {
    format: {
      title: "Format",
      default: "mp4",
      oneOf: [
        { const: "mp4", title: "MP4" },
        { const: "webm", title: "WebM" },
        { const: "png", title: "PNG frames" },
      ],
      description: "MP4 plays everywhere, WebM is free of patents, PNG frames are lossless, in a zip.",
      group: "Film",
    },
    quality: { title: "Compression", type: "integer", minimum: 0, maximum: 51, default: 20, description: "Lower is finer and larger; 0 loses nothing. Not used for PNG.", group: "Film" },
    seed: { title: "Seed", type: "integer", minimum: 0, default: 0, description: "Another seed, another hand: chance falls differently, all else stays.", group: "Film" },
    name: { title: "Name", type: "string", default: "", description: "Shown among the works; the file's name if left empty.", group: "Film" },
    ...(artefacts.length && {
      artefacts: { title: "Also make", type: "array", items: { oneOf: artefacts.map((name) => ({ const: name, title: artefactTitle(name) })) }, default: [], description: "More files that can be downloaded when the film is done.", group: "Film" },
    }),
  },
});

/** The parts of a job request that the form's values say; the job is named after the file if it has no name. */
export const outputOf = ({ format = "mp4", quality = 20, artefacts = [], name = "" }, asset) => ({
  output: { format, quality, artefacts },
  name: name || asset.filename.replace(/\.[^.]+$/, ""),
});

/** The output of the job: the same kind of form as parameters have, from a schema of the page. */

import type { JobBody } from "../api/api";
import { outputOf as formatOf, outputs } from "../api/formats";
import type { Asset, Method, Output, Params, Schema } from "../api/schemas";
import { artefactTitle } from "../ui/format";

const GROUP = "Film";

/** What a method makes besides its film. */
type Makes = Pick<Method, "artefacts" | "makes_passes">;

/** Schema of the form for a format, with its profiles and the optional artefacts and passes that a method offers. */
export function outputSchema({ artefacts, makes_passes: passes }: Makes, format?: string): Schema {
  const { profiles } = formatOf(format);
  const more: Schema = {
    title: "Also make",
    type: "array",
    items: { oneOf: artefacts.map((name) => ({ const: name, title: artefactTitle(name) })) },
    default: [],
    description: "More files that can be downloaded when the film is done.",
    group: GROUP,
  };
  return {
    type: "object",
    properties: {
      format: {
        title: "Format",
        default: "mp4",
        oneOf: outputs.map(({ name, title }) => ({ const: name, title })),
        description: outputs.map(({ title, help }) => `${title}: ${help}.`).join(" "),
        group: GROUP,
      },
      profile: {
        title: "Encoding",
        default: "",
        oneOf: profiles.map(({ name, title, help }, at) => ({
          const: at ? name : "",
          title: help ? `${title}: ${help}` : title,
        })),
        description: "Codec, colour resolution and depth.",
        group: GROUP,
      },
      alpha: {
        title: "Opacity",
        default: "auto",
        oneOf: [
          { const: "auto", title: "of the video, if the encoding has opacity" },
          { const: "source", title: "of the video" },
          { const: "painted", title: "of the paint, if the method makes one" },
          { const: "none", title: "none: the video is painted over white" },
        ],
        description: "For videos with transparent parts.",
        group: GROUP,
      },
      colour: {
        title: "Colour space",
        type: "string",
        default: "",
        description:
          "Images of more than 8 bits: a name of OpenColorIO, such as ACEScg. 10-bit video: PQ or HLG. Empty: sRGB.",
        group: GROUP,
      },
      quality: {
        title: "Compression",
        type: "integer",
        minimum: 0,
        maximum: 51,
        default: 20,
        description: "Lower is finer and larger; 0 loses nothing. Only encodings with loss use it.",
        group: GROUP,
      },
      seed: {
        title: "Seed",
        type: "integer",
        minimum: 0,
        default: 0,
        description: "Another number gives other random details; everything else stays.",
        group: GROUP,
      },
      name: {
        title: "Name",
        type: "string",
        default: "",
        description: "Shown among the works; the file's name if left empty.",
        group: GROUP,
      },
      report: {
        title: "Quality report",
        type: "boolean",
        default: false,
        description: "Measure flicker, detail, sharpness and faces of the film against the video.",
        group: GROUP,
      },
      ...(artefacts.length && { artefacts: more }),
      ...(passes.length && {
        passes: {
          title: "Passes",
          type: "array",
          items: { oneOf: passes.map(({ name }) => ({ const: name, title: artefactTitle(name) })) },
          default: [],
          description: `Images for compositing, of every frame. ${passes.map(({ name, help }) => `${artefactTitle(name)}: ${help}`).join(" ")}`,
          group: GROUP,
        },
        passes_format: {
          title: "Files of the passes",
          default: "",
          oneOf: [
            { const: "", title: "one image a frame, with a layer for each pass" },
            { const: "png", title: "PNG of 16 bit, a folder for each pass" },
            { const: "film", title: "layers in the film's own images, if these can hold any" },
          ],
          description: "Layers keep the exact values; PNG has them scaled, as the documentation says.",
          group: GROUP,
        },
      }),
    },
  };
}

/** The values of the form without a profile of another format, after the format was changed. */
export function fitting<T extends Params>(values: T): T {
  const known = formatOf(values.format as string | undefined).profiles.some(({ name }) => name === values.profile);
  return known || !values.profile ? values : ({ ...values, profile: "" } as T);
}

/** Those parts of a job request that the form's changed values set; the job is named after the file if it has no name. */
export function outputOf(values: Params, asset: Asset): Pick<JobBody, "output" | "name" | "seed"> {
  const output = {
    format: "mp4",
    quality: 20,
    artefacts: [],
    ...pick(fitting(values), ["format", "profile", "alpha", "colour", "quality", "artefacts", "report", "passes"]),
    ...(Array.isArray(values.passes) && values.passes.length > 0 && pick(values, ["passes_format"])),
  } as Output;
  const name = typeof values.name === "string" && values.name ? values.name : asset.filename.replace(/\.[^.]+$/, "");
  return { output, name, seed: typeof values.seed === "number" ? values.seed : 0 };
}

function pick(values: Params, names: string[]): Params {
  return Object.fromEntries(Object.entries(values).filter(([name]) => names.includes(name)));
}

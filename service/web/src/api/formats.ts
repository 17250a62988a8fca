/** The formats of the service: `python -m service.page_formats` writes their list from the registry of formats. */

import formats from "./formats.json";
import type { OutputName } from "./schemas";

export interface OutputFormat {
  name: OutputName;
  title: string;
  help: string;
  /** Short name of the file, for buttons. */
  file: string;
  hasQuality: boolean;
  /** Extension of the file. */
  suffix: string;
  /** Its encodings, the usual one first. */
  profiles: { name: string; title: string; help: string; hasQuality: boolean; hasAlpha: boolean }[];
  /** Whether a film in this format is too coarse to be converted. */
  lossy: boolean;
  /** How a browser shows the film: "video", "image", or "sheet" (the contact sheet). */
  shownAs: string;
}

export const outputs: readonly OutputFormat[] = formats.outputs as OutputFormat[];

/** The format of this name; the first one if it is unknown or not given. */
export const outputOf = (name: string | undefined): OutputFormat =>
  (outputs.find((form) => form.name === name) ?? outputs[0]) as OutputFormat;

/** Types of files that a file picker offers. */
export const accept: { video: string; image: string } = formats.accept;

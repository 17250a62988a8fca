/** The types of the HTTP API under the names that the pages use; all are generated from its OpenAPI document. */

import type { components } from "../../types/api";

/** The schemas of the HTTP API, by name. */
export type Schemas = components["schemas"];

export type Asset = Omit<Schemas["Asset"], "info"> & { info: AssetInfo };
export type Job = Omit<Schemas["JobOut"], "request"> & { request: JobRequest };
type JobRequest = Omit<Schemas["JobRequest"], "output"> & { output?: Output };
export type Step = Schemas["StepView"];
export type Output = Schemas["OutputIn"];
/** Name of an output format. */
export type OutputName = NonNullable<Output["format"]>;
export type Fault = Schemas["Fault"];
export type RunState = Schemas["RunState"];
export type InputSpec = Schemas["InputSpec"];
/** What a field for a file shows of an input. */
export type FileInput = Pick<InputSpec, "name" | "kind" | "required" | "title" | "help">;
export type Example = Schemas["Example"];
export type Method = Omit<Schemas["MethodOut"], "params_schema"> & { params_schema: Schema };
/** A section of the studio's panel as a method describes it: an editor of a part of the layer. */
export type Section = Schemas["Section"];
export type Overlay = Schemas["Overlay"];
export type PreviewKind = Overlay["preview"];
export type PreviewRequest = Schemas["PreviewIn"];
/** Parameters of a method, by name. */
export type Params = Record<string, unknown>;
/** Asset ids by name of the input. */
export type Inputs = Record<string, string>;

export interface Page<Item> {
  items: Item[];
  cursor?: string | null;
}

/** What is known of a file; the document leaves it open, for it depends on the kind of file. */
export interface AssetInfo {
  width?: number;
  height?: number;
  frames?: number;
  fps?: number;
  duration_s?: number;
  rotation_deg?: number;
  has_audio?: boolean;
  /** What is wrong with the file, one sentence; empty: nothing. */
  damage?: string;
  /** Render passes of a sequence: `kinds` that methods may use, such as "motion". */
  passes?: { kinds?: string[] };
}

/** Conditions under which a parameter or an input has an effect; all must hold. */
export interface When {
  /** Parameter -> values of which it must have one. */
  params?: Record<string, string[]>;
  /** Parameter -> number that its value must exceed. */
  above?: Record<string, number>;
  /** Inputs of which one must be given. */
  inputs?: string[];
  /** Inputs of which none may be given. */
  without?: string[];
  /** Kinds of render passes of which the video may have none. */
  without_passes?: string[];
  /** film: not in streams; piece: only in a piece of a film. */
  way?: "" | "film" | "piece";
}

/** The part of JSON Schema that pydantic writes for parameters, with keywords of our own from `unit` on. */
export interface Schema {
  $defs?: Record<string, Schema>;
  $ref?: string;
  allOf?: Schema[];
  anyOf?: Schema[];
  oneOf?: Schema[];
  properties?: Record<string, Schema>;
  items?: Schema;
  type?: string | string[];
  enum?: unknown[];
  const?: unknown;
  title?: string;
  description?: string;
  default?: unknown;
  minimum?: number;
  maximum?: number;
  exclusiveMinimum?: number;
  exclusiveMaximum?: number;
  multipleOf?: number;
  maxItems?: number;
  /** "color": a text of the form #rrggbb; "colors": a list of such. */
  format?: string;
  unit?: string;
  symbol?: string;
  group?: string;
  applies_when?: When[];
  /** Whether the number may have values over time: [[frame, value], ...]. */
  varies?: boolean;
  nullable?: boolean;
}

/** The JSON of the HTTP API, as far as the pages use it. The full description is the service's /openapi.json. */

import type { components } from "../../types/api";

/** Name of an output format. */
export type OutputName = NonNullable<components["schemas"]["OutputIn"]["format"]>;
export type Json = null | boolean | number | string | Json[] | { [name: string]: Json };
/** Parameters of a method, by name. */
export type Params = Record<string, Json>;
/** Asset ids by name of the input. */
export type Inputs = Record<string, string>;

export interface AssetInfo {
  width?: number;
  height?: number;
  frames?: number;
  fps?: number;
  duration_s?: number;
  rotation_deg?: number;
  /** What is wrong with the file, one sentence; empty: nothing. */
  damage?: string;
}

export interface Asset {
  id: string;
  filename: string;
  size_bytes: number;
  media_type: string;
  /** "video", "image", "archive" or "json". */
  kind: string;
  info: AssetInfo;
}

export type RunState = "queued" | "running" | "paused" | "succeeded" | "failed" | "cancelled";

export interface Fault {
  code: string;
  message: string;
  remedy?: string;
  field?: string;
}

/** A fact that the user of a job should know although the job continues. */
export interface JobWarning {
  code: string;
  message: string;
  input: string;
}

export interface Step {
  name: string;
  title: string;
  state: string;
  counts: Record<string, number>;
  progress: number;
  seconds: number;
  stages: Record<string, number>;
  /** Tasks whose results were taken over from an earlier film. */
  reused?: number;
  /** CPU seconds, and the largest memory of a process, bytes; 0 where nothing was measured. */
  cpu_s: number;
  peak_bytes: number;
}

export interface Output {
  format?: OutputName;
  quality?: number;
  artefacts?: string[];
  /** Measure the film against its source. */
  report?: boolean;
}

export interface JobRequest {
  method: string;
  inputs: Inputs;
  params: Params;
  seed?: number;
  output?: Output;
  name?: string;
  priority?: number;
  labels?: Record<string, string>;
  /** [first, end) of the video; null: all. */
  frames?: [first: number, end: number] | null;
}

export interface Job {
  id: string;
  state: RunState;
  request: JobRequest;
  owner: string;
  /** Seconds since the epoch, as all times. */
  created_at: number;
  started_at: number | null;
  finished_at: number | null;
  /** 0..1 */
  progress: number;
  /** Seconds left; null while unknown. */
  eta_s: number | null;
  counts: Record<string, number>;
  steps: Step[];
  error: Fault | null;
  results: string[];
  warnings?: JobWarning[];
}

export interface Page<Item> {
  items: Item[];
  cursor: string | null;
}

export type InputKind = "video" | "image" | "image-or-video" | "images" | "json";

export interface InputSpec {
  name: string;
  kind: InputKind;
  required: boolean;
  title: string;
  help: string;
}

export interface Example {
  name: string;
  title: string;
  params: Params;
}

export interface Method {
  name: string;
  title: string;
  summary: string;
  inputs: InputSpec[];
  params_schema: Schema;
  defaults: Params;
  examples: Example[];
  artefacts: string[];
  thumbnail: string;
}

/** The part of JSON Schema that pydantic writes for parameters, with our own `unit`, `symbol` and `group`. */
export interface Schema {
  $defs?: Record<string, Schema>;
  $ref?: string;
  allOf?: Schema[];
  anyOf?: Schema[];
  oneOf?: Schema[];
  properties?: Record<string, Schema>;
  items?: Schema;
  type?: string;
  enum?: Json[];
  const?: Json;
  title?: string;
  description?: string;
  default?: Json;
  minimum?: number;
  maximum?: number;
  exclusiveMinimum?: number;
  exclusiveMaximum?: number;
  multipleOf?: number;
  unit?: string;
  symbol?: string;
  group?: string;
  nullable?: boolean;
}

/** The body of a preview: one frame of a job that is not submitted. */
export interface PreviewRequest {
  method: string;
  inputs: Inputs;
  params: Params;
  seed?: number;
  frame: number;
  max_side_px?: number;
}

/** A part of a page that was built by hand: its element, and what to call when it leaves the page. */
export interface View {
  element: HTMLElement;
  close(): void;
}

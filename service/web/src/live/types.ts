/** The JSON and binary messages of docs/live.md, and data that the parts of the live page exchange. */

import type { ProblemFields } from "../api/api";
import type { Inputs, Params, Schemas } from "../api/schemas";

export interface Size {
  width: number;
  height: number;
}

export interface Shape extends Size {
  fps: number;
}

/** GET /v1/live. */
export type LiveInfo = Schemas["LiveOut"] & {
  /** Seconds after which to ask again if there is no room. */
  retryAfterS: number;
};

export interface Ready {
  type: "ready";
  session: string;
  resumed: boolean;
  send: { codec: string };
  receive: Receive;
  fps: number;
}

/** How the service encodes its frames. */
export interface Receive {
  codec: string;
  webcodecs?: string;
}

/** Why frames are painted at the present size. */
export interface SizeReason {
  reason: "slow" | "room" | "input";
  /** Delay that 95 % of the frames at the previous size did not exceed, and the allowed delay. */
  latency_ms?: number;
  deadline_ms?: number;
}

export interface FilterChoice {
  method: string;
  params: Params;
}

export interface Stats {
  type: "stats";
  received: number;
  painted: number;
  dropped: number;
  width: number;
  height: number;
  scale: number;
  size: SizeReason;
  stages_ms: Record<string, number>;
}

export type Incoming =
  | Ready
  | Stats
  | ({ type: "resolution"; width: number; height: number; scale: number } & SizeReason)
  | { type: "params"; params: Params }
  | { type: "keyframe" }
  | { type: "replaced" }
  | { type: "bye"; stats: Stats }
  | { type: "error"; fatal: boolean; problem: ProblemFields; retry_after_s?: number };

/** The user's settings in the form that a stream needs. Inputs that are not given are null. */
export interface LiveSettings {
  method: string;
  params: Params;
  inputs: Record<string, string | null>;
  filter: FilterChoice | null;
  prefer: "fluent" | "sharp";
  /** Pixels of a frame, whatever its shape. */
  area: number;
  fps: number;
  codec: string;
  quality: number;
}

export interface Hello extends Shape {
  type: "hello";
  method: string;
  params: Params;
  inputs: Inputs;
  filter: FilterChoice | null;
  prefer: "fluent" | "sharp";
  send: string[];
  receive: string[];
  quality: number;
}

/** A frame on its way to the service. */
export interface OutgoingFrame extends Size {
  payload: Uint8Array<ArrayBuffer>;
  key: boolean;
  /** Time of its capture, on the clock of `performance.now()`. */
  timeUs: number;
}

/** A painted frame as it came back. */
export interface IncomingFrame extends OutgoingFrame {
  sequence: number;
  serverMs: number;
  /** Length of the whole message. */
  bytes: number;
}

export type ConnectionState =
  | { name: "connecting" | "live" | "closed" }
  /** `until`: time of the next attempt, on the clock of `performance.now()`. */
  | { name: "waiting"; why: "busy" | "lost"; until: number }
  | { name: "failed"; problem: import("../api/api").Problem };

export type SourceKind = "camera" | "screen" | "file";

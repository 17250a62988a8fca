/** The record stream of previews: length of the header (uint32, big-endian), header (JSON, UTF-8), payload. */

import type { ProblemFields } from "../../api/api";
import type { DirectionKey } from "./design";

interface RecordHeader {
  type: string;
  /** Length of the payload. */
  bytes: number;
}

export interface FrameHeader extends RecordHeader {
  type: "frame";
  frame: number;
  pass: number;
  final: boolean;
  scale: number;
  width: number;
  height: number;
  media_type: string;
  ms: number;
  /** Of a style card. */
  card?: string;
}

interface MapHeader extends RecordHeader {
  type: "map";
  frame: number;
  width: number;
  height: number;
  media_type: string;
  /** Of a map of the film's regions: their names, by number. */
  names?: string[];
}

export interface RegionsHeader extends RecordHeader {
  type: "regions";
  tubes: Record<string, { object: number; area: number }>;
  objects: Record<string, { tubes: number[]; area: number }>;
}

interface FieldHeader extends RecordHeader {
  type: "field";
  frame: number;
  columns: number;
  rows: number;
  spacing_px: number;
  final: boolean;
  /** What the design sets at this time, by region, as in a key at this frame. */
  moved?: Record<string, Partial<DirectionKey>>;
}

interface KeysHeader extends RecordHeader {
  type: "keys";
  frames: number[];
}

interface CutsHeader extends RecordHeader {
  type: "cuts";
  /** First frames of all shots but the first. */
  cuts: number[];
}

interface MaskHeader extends RecordHeader {
  type: "mask";
  frame: number;
  width: number;
  height: number;
  media_type: string;
}

interface ClustersHeader extends RecordHeader {
  type: "clusters";
  frame: number;
  uncertainty: Record<string, number>;
}

export interface FlickerHeader extends RecordHeader {
  type: "flicker";
  frame: number;
  flicker: number | null;
  error: number | null;
}

export type PreviewHeader =
  | FrameHeader
  | MapHeader
  | RegionsHeader
  | FieldHeader
  | KeysHeader
  | CutsHeader
  | MaskHeader
  | FlickerHeader
  | ClustersHeader
  | (RecordHeader & { type: "begin"; seq: number })
  | (RecordHeader & { type: "progress"; done: number; note: string; cuts?: number[] })
  | (RecordHeader & { type: "error"; problem: ProblemFields })
  | (RecordHeader & { type: "overtaken" })
  | (RecordHeader & { type: "end"; ms: number });

export interface PreviewRecord {
  header: PreviewHeader;
  payload: Uint8Array<ArrayBuffer>;
}

/** Collects bytes as they arrive and cuts complete records off the front. */
export class RecordReader {
  private parts: Uint8Array<ArrayBuffer>[] = [];
  private length = 0;
  /** Number of bytes that are needed to read the next record: parts are joined once these have arrived. */
  private needed = 4;

  /** The records that are complete with these bytes. */
  push(bytes: Uint8Array<ArrayBuffer>): PreviewRecord[] {
    this.parts.push(bytes);
    this.length += bytes.length;
    const found: PreviewRecord[] = [];
    for (let record = this.next(); record; record = this.next()) found.push(record);
    return found;
  }

  private next(): PreviewRecord | null {
    if (!this.has(4)) return null;
    const buffer = this.joined();
    const start = 4 + new DataView(buffer.buffer, buffer.byteOffset).getUint32(0);
    if (!this.has(start)) return null;
    const header: PreviewHeader = JSON.parse(new TextDecoder().decode(buffer.subarray(4, start)));
    const end = start + header.bytes;
    if (!this.has(end)) return null;
    this.parts = [buffer.slice(end)];
    this.length -= end;
    this.needed = 4;
    return { header, payload: buffer.slice(start, end) };
  }

  private has(length: number): boolean {
    this.needed = Math.max(this.needed, length);
    return this.length >= this.needed;
  }

  private joined(): Uint8Array<ArrayBuffer> {
    if (this.parts.length === 1 && this.parts[0]) return this.parts[0];
    const whole = new Uint8Array(this.length);
    let at = 0;
    for (const part of this.parts) {
      whole.set(part, at);
      at += part.length;
    }
    this.parts = [whole];
    return whole;
  }
}

/** The record stream of previews: length of the header (uint32, big-endian), header (JSON, UTF-8), payload. */

import type { ProblemFields } from "../shared/api";

export interface RecordHeader {
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

export interface MapHeader extends RecordHeader {
  type: "map";
  frame: number;
  width: number;
  height: number;
  media_type: string;
}

export interface RegionsHeader extends RecordHeader {
  type: "regions";
  tubes: Record<string, { object: number; area: number }>;
  objects: Record<string, { tubes: number[]; area: number }>;
}

export interface FieldHeader extends RecordHeader {
  type: "field";
  frame: number;
  columns: number;
  rows: number;
  spacing_px: number;
}

export interface KeysHeader extends RecordHeader {
  type: "keys";
  frames: number[];
}

export interface CutsHeader extends RecordHeader {
  type: "cuts";
  /** First frames of all shots but the first. */
  cuts: number[];
}

export interface MaskHeader extends RecordHeader {
  type: "mask";
  frame: number;
  width: number;
  height: number;
  media_type: string;
}

export interface ClustersHeader extends RecordHeader {
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
  private buffer = new Uint8Array(0);

  /** The records that are complete with these bytes. */
  push(bytes: Uint8Array): PreviewRecord[] {
    const joined = new Uint8Array(this.buffer.length + bytes.length);
    joined.set(this.buffer);
    joined.set(bytes, this.buffer.length);
    this.buffer = joined;
    const found: PreviewRecord[] = [];
    for (let record = this.next(); record; record = this.next()) found.push(record);
    return found;
  }

  private next(): PreviewRecord | null {
    if (this.buffer.length < 4) return null;
    const length = new DataView(this.buffer.buffer, this.buffer.byteOffset).getUint32(0);
    if (this.buffer.length < 4 + length) return null;
    const header: PreviewHeader = JSON.parse(new TextDecoder().decode(this.buffer.subarray(4, 4 + length)));
    const end = 4 + length + header.bytes;
    if (this.buffer.length < end) return null;
    const payload = this.buffer.slice(4 + length, end);
    this.buffer = this.buffer.slice(end);
    return { header, payload };
  }
}

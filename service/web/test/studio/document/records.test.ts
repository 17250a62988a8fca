import { expect, test } from "vitest";
import { RecordReader } from "../../../src/studio/document/records";

function bytesOf(header: object, payload: number[] = []): Uint8Array {
  const text = new TextEncoder().encode(JSON.stringify({ ...header, bytes: payload.length }));
  const whole = new Uint8Array(4 + text.length + payload.length);
  new DataView(whole.buffer).setUint32(0, text.length);
  whole.set(text, 4);
  whole.set(payload, 4 + text.length);
  return whole;
}

test("records are read whole however their bytes arrive", () => {
  const stream = [
    ...bytesOf({ type: "begin", seq: 1 }),
    ...bytesOf({ type: "frame", frame: 3 }, [1, 2, 3]),
    ...bytesOf({ type: "end", ms: 1 }),
  ];
  for (const piece of [1, 3, 7, stream.length]) {
    const reader = new RecordReader();
    const found = [];
    for (let i = 0; i < stream.length; i += piece)
      found.push(...reader.push(new Uint8Array(stream.slice(i, i + piece))));
    expect(found.map((record) => record.header.type)).toEqual(["begin", "frame", "end"]);
    expect([...(found[1]?.payload ?? [])]).toEqual([1, 2, 3]);
  }
});

import { expect, test } from "vitest";
import { parse } from "../../src/api/events";

test("complete messages are cut off, the rest is kept", () => {
  const [messages, rest] = parse(": ping\n\nid: 7\nevent: job.state\ndata: {\ndata: }\n\nid: 8\nda");
  expect(messages).toEqual([{ id: "7", type: "job.state", data: "{\n}" }]);
  expect(rest).toBe("id: 8\nda");
});

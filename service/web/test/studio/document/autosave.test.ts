import { expect, test, vi } from "vitest";
import { Problem } from "../../../src/api/api";
import { createSaver, type SaveState } from "../../../src/studio/document/autosave";
import { newDocument, type ProjectDocument } from "../../../src/studio/document/document";

const first = newDocument("Swan", "ast_1", "analogy");
const named = (name: string): ProjectDocument => ({ ...first, name });

function setUp(save: (document: ProjectDocument, version: number) => Promise<number>) {
  vi.useFakeTimers();
  const states: SaveState[] = [];
  const kept: (ProjectDocument | null)[] = [];
  const saver = createSaver({
    version: 1,
    document: first,
    save,
    asProblem: (error) => error as Problem,
    onstate: (state) => states.push(state),
    keep: (document) => kept.push(document),
  });
  return { saver, states, kept };
}

test("changes are saved together within a second", async () => {
  const save = vi.fn(async (_document: ProjectDocument, version: number) => version + 1);
  const { saver, states } = setUp(save);
  saver.changed(named("a"));
  saver.changed(named("b"));
  await vi.advanceTimersByTimeAsync(1000);
  expect(save.mock.calls.map(([document, version]) => [document.name, version])).toEqual([["b", 1]]);
  expect(states.at(-1)).toEqual({ name: "saved" });
  expect(saver.version).toBe(2);
});

test("without a network the changes are kept and saved when it is back", async () => {
  let offline = true;
  const { saver, states, kept } = setUp(async (_document, version) => {
    if (offline) throw new Problem({ code: "offline" });
    return version + 1;
  });
  saver.changed(named("a"));
  await vi.advanceTimersByTimeAsync(1000);
  expect(states.at(-1)?.name).toBe("offline");
  expect(kept.at(-1)?.name).toBe("a");
  offline = false;
  await vi.advanceTimersByTimeAsync(4000);
  expect(states.at(-1)?.name).toBe("saved");
  expect(kept.at(-1)).toBeNull();
});

test("another tab's version is never overwritten without a decision", async () => {
  const save = vi.fn(async (_document: ProjectDocument, version: number) => {
    if (version < 9) throw new Problem({ status: 412 });
    return 10;
  });
  const { saver, states } = setUp(save);
  saver.changed(named("a"));
  await vi.advanceTimersByTimeAsync(1000);
  saver.changed(named("b"));
  await vi.advanceTimersByTimeAsync(5000);
  expect(states.at(-1)?.name).toBe("conflict");
  expect(save).toHaveBeenCalledTimes(1);
  await saver.overwrite(9);
  expect(save.mock.lastCall?.[0].name).toBe("b");
  expect(saver.version).toBe(10);
});

test("a change during a slow save is saved once, over the version that this save gives", async () => {
  const save = vi.fn(async (_document: ProjectDocument, version: number) => {
    await new Promise((done) => setTimeout(done, 1000));
    return version + 1;
  });
  const { saver, states } = setUp(save);
  saver.changed(named("a"));
  await vi.advanceTimersByTimeAsync(600); // it is being saved
  saver.changed(named("b"));
  await vi.advanceTimersByTimeAsync(5000);
  expect(save.mock.calls.map(([document, version]) => [document.name, version])).toEqual([
    ["a", 1],
    ["b", 2],
  ]);
  expect(states.at(-1)).toEqual({ name: "saved" });
  expect(await saver.flush()).toBe(true);
});

import { expect, test, vi } from "vitest";

vi.stubGlobal("localStorage", { getItem: () => null, setItem: () => {} });
const { chosen, COMMANDS, chordOf, chordText, commandOf, conflict, keyOf, withKey } = await import(
  "../../../src/studio/state/key-bindings"
);

const pressed = (key: string, more: Partial<KeyboardEvent> = {}) =>
  chordOf({ key, shiftKey: false, ctrlKey: false, metaKey: false, altKey: false, ...more });

test("no two commands have one usual key, and none has a key of the page", () => {
  const keys = COMMANDS.map(({ key }) => key);
  expect(new Set(keys).size).toBe(keys.length);
  for (const { id, key } of COMMANDS) expect(conflict(id, key, {})).toBeNull();
});

test("a pressed key is written as the commands have it", () => {
  expect(pressed("b")).toBe("b");
  expect(pressed("B", { shiftKey: true })).toBe("Shift+b");
  expect(pressed("?", { shiftKey: true })).toBe("?");
  expect(pressed("+", { shiftKey: true })).toBe("+");
  expect(pressed(" ", { shiftKey: true })).toBe("Shift+Space");
  expect(pressed("ArrowLeft", { shiftKey: true })).toBe("Shift+ArrowLeft");
  expect(pressed("Z", { metaKey: true, shiftKey: true })).toBe("Ctrl+Shift+z");
  expect(pressed("Shift", { shiftKey: true })).toBe("");
  expect(chordText("Ctrl+Shift+z")).toBe("Ctrl+Shift+Z");
  expect(chordText("+")).toBe("+");
  expect(chordText("Shift+ArrowLeft")).toBe("Shift+Left");
});

test("a key that another command has is named, and taken from it", () => {
  expect(conflict("marker", "b", {})?.taken?.id).toBe("brush");
  expect(conflict("marker", "Escape", {})).toEqual({});
  const chosen = withKey("marker", "b", {});
  expect(chosen).toEqual({ marker: "b", brush: "" });
  expect(conflict("marker", "m", chosen)).toBeNull();
  const brush = COMMANDS.find(({ id }) => id === "brush");
  expect(brush && keyOf(brush, chosen)).toBe("");
});

test("the usual key again leaves nothing to keep", () => {
  expect(withKey("marker", "m", withKey("marker", "5", {}))).toEqual({});
  expect(withKey("marker", "", {})).toEqual({ marker: "" });
});

test("a chosen key stays that of its command when another command has it by default", () => {
  chosen.value = { next: "y" };
  expect(commandOf("y")).toBe("next");
  chosen.value = {};
  expect(commandOf("y")).toBe("matteBrush");
});

/** Building elements without templates: text is only ever text, so that no input can become markup. */

export type Child = Node | string | null | undefined | false | Child[];
type Listener = (event: never) => unknown;
export type Props = Record<string, string | number | boolean | null | undefined | Listener>;

/**
 * Make an element. `on...` properties are listeners, `class` is the class, an own property of the element is assigned,
 * all else is an attribute; `null`, `undefined` and `false` are left out, both as properties and as children.
 */
export function h<Tag extends keyof HTMLElementTagNameMap>(
  tag: Tag,
  props: Props = {},
  ...children: Child[]
): HTMLElementTagNameMap[Tag] {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(props)) assign(element, name, value);
  element.append(...present(children));
  return element;
}

function assign(element: HTMLElement, name: string, value: Props[string]): void {
  if (value === null || value === undefined || value === false) return;
  if (typeof value === "function") element.addEventListener(name.slice(2), value as unknown as EventListener);
  else if (name === "class") element.className = String(value);
  else if (name in element && !name.includes("-") && typeof value !== "string") Reflect.set(element, name, value);
  else element.setAttribute(name, value === true ? "" : String(value));
}

function present(children: Child[]): (Node | string)[] {
  return children.flatMap((child) => {
    if (Array.isArray(child)) return present(child);
    return child === null || child === undefined || child === false ? [] : [child];
  });
}

/** Replace everything inside `element`. */
export function fill(element: Element, ...children: Child[]): void {
  element.replaceChildren(...present(children).filter((child) => child !== ""));
}

/** The element with this id, which the page's HTML has. */
export function byId(id: string): HTMLElement {
  const element = document.getElementById(id);
  if (!element) throw new Error(`The page has no element #${id}.`);
  return element;
}

let count = 0;
/** An id that no other element has. */
export function unique(prefix: string): string {
  count += 1;
  return `${prefix}-${count}`;
}

/** A part of a page that was built by hand: its element, and what to call when it leaves the page. */
export interface View {
  element: HTMLElement;
  close(): void;
}

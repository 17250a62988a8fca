/** Tables that are refreshed again and again: unchanged cells are left alone, so that focus and selection stay. */

import { type Child, fill, h } from "../ui/dom";

/** A text, or a text that changes whenever the cell has to be drawn anew, and how to draw it. */
export type Cell = string | [version: string, draw: () => Child];

export interface TableOptions<Item> {
  name: string;
  columns: string[];
  key(item: Item): string;
  cells(item: Item): Cell[];
  /** Shown instead of a table without rows. */
  empty: string;
  /** The state of a row, for its colour. */
  state?(item: Item): string;
}

export interface Updated<Item> {
  element: HTMLElement;
  update(items: Item[]): void;
}

interface Row<Item> {
  element: HTMLElement;
  update(item: Item): void;
}

export function createTable<Item>(options: TableOptions<Item>): Updated<Item> {
  const { name, columns, key, empty } = options;
  const body = h("tbody", {});
  const head = h(
    "thead",
    {},
    h(
      "tr",
      {},
      columns.map((title) => h("th", { scope: "col" }, title || h("span", { class: "visually-hidden" }, "Actions"))),
    ),
  );
  const caption = h("caption", { class: "visually-hidden" }, name);
  const table = h("table", { class: `grid grid-${name}` }, caption, head, body);
  const placeholder = h("p", { class: "placeholder" }, empty);
  const rows = new Map<string, Row<Item>>();
  return {
    element: h("div", { class: "grid-box" }, table, placeholder),
    update(items) {
      table.hidden = !items.length;
      placeholder.hidden = items.length > 0;
      place(body, rows, items, key, (item) => createRow(options, item));
    },
  };
}

/** Keep one element for each item, in the order of the items. */
export function place<Item>(
  host: HTMLElement,
  rows: Map<string, Row<Item>>,
  items: Item[],
  key: (item: Item) => string,
  make: (item: Item) => Row<Item>,
): void {
  const wanted = new Set(items.map(key));
  for (const [id, row] of rows) {
    if (wanted.has(id)) continue;
    row.element.remove();
    rows.delete(id);
  }
  items.forEach((item, index) => {
    const row = rows.get(key(item)) ?? make(item);
    rows.set(key(item), row);
    row.update(item);
    if (host.children[index] !== row.element) host.insertBefore(row.element, host.children[index] ?? null);
  });
}

function createRow<Item>({ columns, cells, state }: TableOptions<Item>, first: Item): Row<Item> {
  const boxes = columns.map((title) => h("td", { "data-label": title }));
  const drawn: (string | null)[] = columns.map(() => null);
  const element = h("tr", {}, boxes);
  const update = (item: Item) => {
    element.dataset.state = state?.(item) ?? "";
    cells(item).forEach((cell, i) => {
      const [version, draw] = typeof cell === "string" ? [cell, () => cell] : cell;
      const box = boxes[i];
      if (!box || drawn[i] === version) return;
      drawn[i] = version;
      fill(box, draw());
    });
  };
  update(first);
  return { element, update };
}

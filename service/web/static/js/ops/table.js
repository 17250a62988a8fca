/** Tables that are looked at again and again: what has not changed is not touched, so that focus and selection stay. */

import { fill, h } from "../dom.js";

/**
 * @param {{name: string, columns: string[], key(item): string, cells(item): Array<string | [string, () => any]>,
 *   empty: string}} options  A cell is a text, or what tells it from its last version and how to make it.
 * @returns {{element, update(items)}}
 */
export function createTable({ name, columns, key, cells, empty }) {
  const body = h("tbody", {});
  const head = h("thead", {}, h("tr", {}, columns.map((title) => h("th", { scope: "col" }, title))));
  const table = h("table", { class: `grid grid-${name}` }, h("caption", { class: "visually-hidden" }, name), head, body);
  const nothing = h("p", { class: "nothing" }, empty);
  const rows = new Map();
  return {
    element: h("div", { class: "grid-box" }, table, nothing),
    update(items) {
      table.hidden = !items.length;
      nothing.hidden = items.length > 0;
      place(body, rows, items, key, (item) => createRow(columns, cells, item));
    },
  };
}

/** Keep one element an item, in the order of the items. */
export function place(host, rows, items, key, make) {
  const wanted = new Set(items.map(key));
  for (const [id, row] of rows) if (!wanted.has(id)) (row.element.remove(), rows.delete(id));
  items.forEach((item, index) => {
    const known = rows.get(key(item));
    if (known) known.update(item);
    else rows.set(key(item), make(item));
    const { element } = rows.get(key(item));
    if (host.children[index] !== element) host.insertBefore(element, host.children[index] ?? null);
  });
}

function createRow(columns, cells, first) {
  const boxes = columns.map((title) => h("td", { "data-label": title }));
  const drawn = columns.map(() => null);
  const element = h("tr", {}, boxes);
  const update = (item) => {
    element.dataset.state = item.state ?? "";
    cells(item).forEach((cell, i) => {
      const [sign, make] = Array.isArray(cell) ? cell : [cell, () => cell];
      if (drawn[i] === sign) return;
      drawn[i] = sign;
      fill(boxes[i], make());
    });
  };
  update(first);
  return { element, update };
}

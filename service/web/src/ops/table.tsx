/** Tables of the board, and the words that stand in several of them. */

import type { ComponentChildren } from "preact";

export interface TableProps<Item> {
  name: string;
  columns: string[];
  items: Item[];
  id(item: Item): string;
  cells(item: Item): ComponentChildren[];
  /** Shown instead of a table without rows. */
  empty: string;
  /** The state of a row, for its colour. */
  state?(item: Item): string;
}

export function Table<Item>({ name, columns, items, id, cells, empty, state }: TableProps<Item>) {
  if (!items.length)
    return (
      <div class="grid-box">
        <p class="placeholder">{empty}</p>
      </div>
    );
  return (
    <div class="grid-box">
      <table class={`grid grid-${name}`}>
        <caption class="visually-hidden">{name}</caption>
        <thead>
          <tr>
            {columns.map((title) => (
              <th key={title} scope="col">
                {title || <span class="visually-hidden">Actions</span>}
              </th>
            ))}
          </tr>
        </thead>
        <tbody>
          {items.map((item) => (
            <tr key={id(item)} data-state={state?.(item) ?? ""}>
              {cells(item).map((cell, i) => (
                <td key={columns[i]} data-label={columns[i]}>
                  {cell}
                </td>
              ))}
            </tr>
          ))}
        </tbody>
      </table>
    </div>
  );
}

export function Badge({ state, children }: { state: string; children?: ComponentChildren }) {
  return (
    <>
      <span class="badge" data-state={state}>
        {state}
      </span>
      {children && <small>{children}</small>}
    </>
  );
}

/** Words with dots between them; those that are false or empty are left out. */
export const dotted = (...words: (string | number | false | null | undefined)[]): string =>
  words.filter(Boolean).join(" · ");

export interface TileProps {
  name: string;
  value: ComponentChildren;
  more?: string;
  children?: ComponentChildren;
}

/** A figure with its name, for a `<dl class="tiles">`. */
export function Tile({ name, value, more, children }: TileProps) {
  return (
    <div class="tile">
      <dt>{name}</dt>
      <dd>
        {value}
        {more && <small>{more}</small>}
      </dd>
      {children && <dd>{children}</dd>}
    </div>
  );
}

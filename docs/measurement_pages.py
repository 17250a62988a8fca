"""Draws the pages of docs/measurements from their tables: `python -m docs.measurement_pages`.

A table is a CSV file `docs/measurements/tables/PAGE/NN-NAME.csv`, read by `read`; README.md beside the pages describes
it. Tables of a page appear in the order of their file names.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

FOLDER = Path(__file__).parent / "measurements"
PAGES = {
    "abstraction": "Speed, sharpness and steadiness of [abstraction](../abstraction.md)",
    "multistyle": "Speed and steadiness of [multistyle](../multistyle.md)",
    "patches": "Speed, sharpness and steadiness of [patches](../patches.md)",
    "analogy": "Speed, fidelity and steadiness of [analogy](../analogy.md)",
    "steady": "Speed and steadiness of [steady](../steady.md)",
    "faces": "Faces that stay recognisable in a result",
    "flow": "Time and accuracy of optical flow",
    "live": "Latency and loss of [live](../live.md) sessions",
    "studio": "Response times of the [studio](../studio.md)",
    "farm": "The store, the service and the workers",
    "abuse": "What one key can do to the others",
    "testing": "Time and findings of the [tests](../testing.md)",
}
"""Pages in the order of the site, with their first sentence."""
KEYS = ("title", "says", "unit", "date", "machine", "command")
"""Lines at the head of a table, in this order. `title`, `says` and `date` are required."""


@dataclass(frozen=True)
class Table:
    """One table of a page: `head` has values for `KEYS`; `rows` begin with the names of the columns."""

    head: dict[str, str]
    rows: list[list[str]]


def read(file: Path) -> Table:
    """The table of a file. `ValueError` if a line of the head is unknown or missing, or if a row has another number of
    cells than the first one."""
    lines = file.read_text().splitlines()
    marked = [line for line in lines if line.startswith("# ")]
    head = {key: value.strip() for key, _, value in (line[2:].partition(":") for line in marked)}
    unknown = sorted(set(head) - set(KEYS))
    missing = [key for key in ("title", "says", "date") if not head.get(key)]
    if unknown or missing:
        raise ValueError(f"{file.name}: unknown lines {unknown}, missing lines {missing}; known: {', '.join(KEYS)}")
    rows = [row for row in csv.reader(io.StringIO("\n".join(lines[len(marked) :]))) if row]
    uneven = [row[0] for row in rows if len(row) != len(rows[0])]
    if uneven:
        raise ValueError(f"{file.name}: {len(rows[0])} columns, but another number of cells in {uneven}")
    return Table(head, rows)


def page(name: str) -> str:
    """A page of `PAGES` as Markdown."""
    parts = [f"# Measurements: {name}", f"{PAGES[name]}. [How these tables are made](README.md)."]
    for file in sorted((FOLDER / "tables" / name).glob("*.csv")):
        parts += _section(read(file))
    return "\n\n".join(parts) + "\n"


def _section(table: Table) -> Iterator[str]:
    head = table.head
    yield f"## {head['title']}"
    yield head["says"] + (f" Unit: {head['unit']}." if head.get("unit") else "")
    names, *rows = table.rows
    yield "\n".join(_line(row) for row in (names, ["---"] * len(names), *rows))
    command = f"`{head['command']}`" if head.get("command") else ""
    yield "*" + ", ".join(filter(None, (head["date"], head.get("machine"), command))) + "*"


def _line(cells: list[str]) -> str:
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def main() -> None:
    """Write every page."""
    for name in PAGES:
        (FOLDER / f"{name}.md").write_text(page(name))


if __name__ == "__main__":
    main()

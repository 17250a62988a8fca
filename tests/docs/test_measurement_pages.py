"""The pages of docs/measurements are those that their tables give."""

from __future__ import annotations

from pathlib import Path

import pytest

from docs.measurement_pages import FOLDER, PAGES, page, read
from docs.site import CHAPTERS

HEAD = "# title: A\n# says: B.\n# date: 2026-11-29\n"


@pytest.mark.parametrize("name", PAGES)
def test_page_is_current(name: str) -> None:
    assert (FOLDER / f"{name}.md").read_text() == page(name), "run python -m docs.measurement_pages"


def test_every_table_belongs_to_a_page_of_the_site() -> None:
    assert {folder.name for folder in (FOLDER / "tables").iterdir()} == set(PAGES)
    assert {f"docs/measurements/{name}" for name in PAGES} <= set(CHAPTERS["Measurements"])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("# title: A\n# date: 2026-11-29\nx\n1\n", "missing lines \\['says'\\]"),
        (HEAD + "# load: 3\nx\n1\n", "unknown lines \\['load'\\]"),
        (HEAD + "x,y\n1,2\n3\n", "2 columns, but another number of cells in \\['3'\\]"),
    ],
)
def test_wrong_tables_are_refused(text: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "10-a.csv"
    file.write_text(text)
    with pytest.raises(ValueError, match=message):
        read(file)

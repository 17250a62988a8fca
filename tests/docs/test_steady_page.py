"""docs/steady.md lists every parameter as the schema describes it."""

from __future__ import annotations

from docs.make_steady_figures import MARKS, PAGE, PICTURE, parameters_table

TEXT = PAGE.read_text()


def test_the_table_equals_the_schema() -> None:
    """If this fails: `python -m docs.make_steady_figures --only table`."""
    begin, end = MARKS
    assert TEXT.partition(begin)[2].partition(end)[0].strip() == "\n".join(parameters_table()).strip()


def test_the_picture_is_there() -> None:
    assert PICTURE.is_file() and f"steady/{PICTURE.name}" in TEXT

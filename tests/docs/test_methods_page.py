"""docs/methods.md lists every built-in method as the registry and the schemas describe it."""

from __future__ import annotations

import re

from docs.parameters import METHODS_PAGE, methods_page
from pipeline.methods import methods


def test_the_methods_page_matches_the_registry() -> None:
    """If this fails: `python -m docs.parameters`."""
    assert METHODS_PAGE.read_text() == methods_page(methods().values())


def test_every_table_row_has_as_many_cells_as_its_header() -> None:
    for found in re.findall(r"(?:^\|.*\n)+", METHODS_PAGE.read_text(), re.M):
        assert len({len(re.findall(r"(?<!\\)\|", row)) for row in found.splitlines()}) == 1, found[:80]

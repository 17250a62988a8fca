"""docs/methods.md lists every built-in method as the registry and the schemas describe it."""

from __future__ import annotations

import re

from docs.parameters import METHODS_PAGE, methods_page
from pipeline.methods import methods


def test_the_page_is_what_the_registry_gives() -> None:
    """If this fails: `python -m docs.parameters`."""
    assert METHODS_PAGE.read_text() == methods_page(methods().values())


def test_every_row_of_a_table_has_as_many_cells_as_its_head() -> None:
    for found in re.findall(r"(?:^\|.*\n)+", METHODS_PAGE.read_text(), re.M):
        assert len({len(re.findall(r"(?<!\\)\|", row)) for row in found.splitlines()}) == 1, found[:80]

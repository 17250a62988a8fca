"""The guide that the studio links to has the text of the tutorial."""

from __future__ import annotations

import re

from docs.make_help_page import PAGE, SOURCE, page


def test_the_guide_matches_its_tutorial() -> None:
    assert PAGE.read_text() == page(), "run: python -m docs.make_help_page"


def test_the_guide_has_every_step_and_no_missing_file() -> None:
    steps = re.findall(r"^## (.+)$", SOURCE.read_text(), re.MULTILINE)
    assert len(steps) > 4
    assert all(f"<h2>{step}</h2>" in PAGE.read_text() for step in steps)
    assert set(re.findall(r'(?:src|href)="([^"]+)"', PAGE.read_text())) == {
        "/", "/docs/docs.css", "/static/img/favicon.svg"
    }  # fmt: skip

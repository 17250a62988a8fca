"""docs/multistyle.md lists every parameter and style as the code has them, and its designs are valid."""

from __future__ import annotations

import json
import re

import pytest

from docs.make_multistyle_figures import (
    FOLDER,
    MARKS,
    PAGE,
    RIPPLES,
    SCHEMA,
    SHOWN,
    parameters_table,
    styles_table,
)
from docs.pictures import CLIPS
from pipeline.methods.multistyle import MultistyleParams
from pipeline.methods.multistyle.design import parse, schema
from pipeline.methods.multistyle.effects import EFFECTS


@pytest.mark.parametrize(("name", "lines"), [("styles", styles_table), ("parameters", parameters_table)])
def test_the_tables_match_the_code(name: str, lines: object) -> None:
    """If this fails: `python -m docs.make_multistyle_figures --only table`."""
    begin, end = MARKS[name]
    text = PAGE.read_text().partition(begin)[2].partition(end)[0]
    assert text.strip() == "\n".join(lines()).strip()  # type: ignore[operator]


def test_the_published_schema_matches_the_code() -> None:
    assert json.loads(SCHEMA.read_text()) == json.loads(json.dumps(schema()))


def test_every_design_on_the_page_is_valid() -> None:
    found = [json.loads(block) for block in re.findall(r"```json\n(.*?)```", PAGE.read_text(), re.S)]
    assert RIPPLES in found
    for document in found:
        parse(document, frames=20, masks=True)


def test_every_picture_exists_is_small_and_uses_a_licensed_clip() -> None:
    named = re.findall(r"\(multistyle/(\w+\.jpg)\)", PAGE.read_text())
    assert len(named) == len(set(named)) and sorted(named) == sorted(path.name for path in FOLDER.iterdir())
    assert all(path.stat().st_size < 260_000 for path in FOLDER.iterdir())
    assert all(CLIPS[clip].credit for clip in SHOWN)


def test_every_effect_is_described() -> None:
    text = PAGE.read_text()
    assert all(f"effect={effect}" in text for effect in EFFECTS[1:]) and "effect" in MultistyleParams.model_fields

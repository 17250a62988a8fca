"""docs/analogy.md documents every parameter, input and term, and its pictures exist."""

from __future__ import annotations

import json
import re

from docs.make_analogy_figures import FIGURES, FOLDER, MARK, PAGE, parameters_table
from pipeline.methods.analogy import Analogy
from pipeline.video.shot_archive import NUMBERED, ShotJson
from pipeline.video.shot_files import PASSES

TEXT = PAGE.read_text()


def test_the_parameter_tables_match_the_schema() -> None:
    """If this fails: `python -m docs.make_analogy_figures --only table`."""
    found = TEXT.partition(MARK[0])[2].partition(MARK[1])[0]
    assert found.strip() == "\n".join(parameters_table()).strip()


def test_every_picture_exists_and_is_small() -> None:
    named = re.findall(r"\(analogy/(\w+)\.jpg\)", TEXT)
    assert sorted(named) == sorted(FIGURES) == sorted(path.stem for path in FOLDER.iterdir())
    assert all(path.stat().st_size < 130_000 for path in FOLDER.iterdir())


def test_every_input_and_step_is_documented() -> None:
    names = [spec.name for spec in Analogy.inputs if not re.fullmatch(r"(style_)?guide_[bc]|video", spec.name)]
    assert [name for name in (*names, *(step.name for step in Analogy.steps)) if f"`{name}`" not in TEXT] == []


def test_every_folder_of_a_shot_is_documented_and_the_example_is_valid() -> None:
    assert [name for name in (*PASSES, *NUMBERED) if f"{name}/" not in TEXT] == []
    shots = [json.loads(block) for block in re.findall(r"```json\n({.*?)```", TEXT, re.S)]
    assert shots and all(ShotJson.model_validate(shot).layers for shot in shots)

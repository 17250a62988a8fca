"""docs/patches.md documents every parameter, input, artefact and step, and its pictures exist."""

from __future__ import annotations

import json
import re

import pytest

from docs.make_patches_figures import ALL, FOLDER, MARKS, PAGE, SHOWN, TITLES, parameters_table
from docs.pictures import CLIPS
from pipeline.methods import parse_params
from pipeline.methods.base import PlanContext, VideoInfo
from pipeline.methods.patches import Patches, PatchesParams
from pipeline.methods.patches.patch_styles import label_styles

TEXT = PAGE.read_text()


def test_the_parameter_tables_match_the_schema() -> None:
    """If this fails: `python -m docs.make_patches_figures --only table`."""
    begin, end = MARKS
    assert TEXT.partition(begin)[2].partition(end)[0].strip() == "\n".join(parameters_table()).strip()


def test_all_rows_of_a_table_have_the_same_number_of_cells() -> None:
    for table in re.findall(r"(?:^\|.*\n)+", TEXT, re.M):
        cells = {len(re.findall(r"(?<!\\)\|", row)) for row in table.splitlines()}
        assert len(cells) == 1, table[:80]


def test_every_picture_exists_is_small_and_has_a_licence() -> None:
    named = re.findall(r"\(patches/(\w+\.jpg)\)", TEXT)
    assert len(named) == len(set(named)) and sorted(named) == sorted(path.name for path in FOLDER.iterdir())
    assert all(path.stat().st_size < 260_000 for path in FOLDER.iterdir())
    assert all(CLIPS[clip].credit for clip in SHOWN)


@pytest.mark.parametrize("part", ["inputs", "artefacts", "steps"])
def test_every_input_artefact_and_step_is_documented(part: str) -> None:
    names = {
        "inputs": [spec.name for spec in Patches.inputs if spec.name != "video"],
        "artefacts": Patches.artefacts, "steps": [step.name for step in Patches.steps],
    }[part]  # fmt: skip
    for name in names:
        assert re.search(rf"^\| `?{name}`? \|", TEXT, re.M), name


def test_the_example_of_styles_is_valid() -> None:
    example = re.search(r'`(\{"background".*?\})`', TEXT)
    assert example
    assert set(label_styles(json.loads(example[1]))) == {1, 3}


def test_parameters_in_the_commands_are_valid() -> None:
    for name, value in re.findall(r"--param (\w+)=(\S+)", TEXT):
        parse_params(Patches(), {name: value})
    assert Patches.steps[0].plan(PlanContext(PatchesParams(), 0, VideoInfo(64, 48, 2, 25.0, 0.1)))


def test_every_value_of_temporal_is_documented() -> None:
    modes = set(PatchesParams.model_json_schema()["properties"]["temporal"]["enum"])
    assert modes == set(TITLES) - {"video", "strokes"} and all(f"temporal={mode}" in TEXT for mode in modes - {"on"})
    assert "pipeline" in ALL

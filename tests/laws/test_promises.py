"""Single promises that once were broken: see the laws for the kinds."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

import impasto
from impasto.cli.app import app
from pipeline.errors import BadParameter
from pipeline.methods.local import LocalContext, run_plan
from tests.laws import ways
from tests.laws.cases import Case
from workers.contract.request import JobRequest, OutputSpec
from workers.farm import Farm, open_farm
from workers.live.sessions import LiveSessions
from workers.settings import FarmSettings


@pytest.fixture(scope="module")
def farm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Farm]:
    opened = open_farm(FarmSettings(home=tmp_path_factory.mktemp("promises"), pool="local", workers=1))
    opened.start()
    yield opened
    opened.stop()


@pytest.mark.parametrize("lines", [(), ("lines",)])
def test_a_shot_without_a_key_has_the_style_of_the_nearest_one(lines: tuple[str, ...]) -> None:
    case = Case(2, "analogy", {}, ("keyframes", *lines), 8, 6, (6, 8))
    context = LocalContext(case.parsed, case.film(), case.given(), seed=2)
    run_plan(case.chosen, context)
    assert "frames 6 to 7" in context.warnings[0]
    keys = np.stack([case.film()[number] for number in (1, 4)])
    colours = {tuple(colour) for colour in (255 - keys).reshape(-1, 3)}
    assert all(tuple(colour) in colours for colour in context.emitted[7].reshape(-1, 3))
    assert ways.difference(ways.piece(case), context.emitted) == 0, "alone, too"


def test_one_frame_of_a_film_is_not_painted_as_a_still() -> None:
    inputs = ("style_output", "style", "guide_a", "style_guide_a")
    case = Case(2, "analogy", {"temporal": "off"}, inputs, 6, 0, (0, 1))
    assert ways.difference(ways.piece(case), ways.film(case)) == 0


@pytest.mark.parametrize("piece", [(2, 3), (3, 6), (5, 7), (8, 12)])
@pytest.mark.parametrize("cut", [0, 7])
def test_a_piece_that_looks_ahead_is_averaged_as_in_the_film(piece: tuple[int, int], cut: int) -> None:
    case = Case(2, "steady", {"look_ahead": 2}, ("styled",), 14, cut, piece)
    assert ways.difference(ways.piece(case), ways.film(case)) == 0


@pytest.mark.parametrize("cut", [0, 3])
@pytest.mark.parametrize(
    ("method", "params", "inputs"),
    [
        ("analogy", {"on_twos": "on", "levels": 2}, ("style_output",)),
        ("analogy", {"on_twos": "on", "levels": 2}, ("keyframes",)),
        ("patches", {"frames_per_painting": 3}, ()),
        ("patches", {"frames_per_painting": 6}, ()),
    ],
)
def test_a_piece_holds_its_paintings_as_the_film(
    method: str, params: dict[str, Any], inputs: tuple[str, ...], cut: int
) -> None:
    whole = Case(2, method, {"temporal": "off", **params}, inputs, 11, cut, (0, 11))
    film = ways.film(whole)
    for piece in ((1, 3), (4, 5), (5, 9), (8, 11)):
        assert ways.difference(ways.piece(replace(whole, piece=piece)), film) == 0, piece


@pytest.mark.parametrize("piece", [(12, 13), (22, 24)])
def test_a_piece_within_a_later_run_of_patches_is_the_film(piece: tuple[int, int]) -> None:
    case = Case(2, "patches", {}, ("masks",), 26, 0, piece)
    assert ways.difference(ways.piece(case), ways.film(case)) == 0


def test_the_library_uses_an_effect_without_an_output_and_live_refuses_it() -> None:
    case = Case(1, "multistyle", {"effect": "emphasis"}, (), 4, 0, (0, 4))
    plain = Case(1, "multistyle", {}, (), 4, 0, (0, 4))
    assert (
        ways.difference(ways.film(case), ways.iterator(case)) == 0 < ways.difference(ways.film(plain), ways.film(case))
    )
    with pytest.raises(BadParameter) as refused:
        LiveSessions.params("multistyle", {"effect": "emphasis"})
    assert refused.value.field == "params.effect"
    with pytest.warns(impasto.library.NoEffect, match="ease"):
        list(impasto.render("multistyle", plain.film(), ease=0.5))


def test_a_film_is_delivered_without_an_artefact_that_cannot_be_made(tiny_clip: Path, tmp_path: Path) -> None:
    out = tmp_path / "film.mp4"
    command = ["render", str(tiny_clip), "-o", str(out), "--method", "patches", "-p", "temporal=off"]
    done = CliRunner().invoke(app, [*command, "--artefact", "labels"], env={"IMPASTO_HOME": str(tmp_path / "home")})
    assert done.exit_code == 0, done.output
    assert out.is_file()
    assert "The artefact 'labels'" in done.output


def test_a_job_is_warned_about_what_has_no_effect(farm: Farm, tiny_clip: Path, tmp_path: Path) -> None:
    video = farm.assets.add(tiny_clip, "tiny.mp4").id
    request = JobRequest("multistyle", {"video": video}, {"ease": 1.0}, output=OutputSpec("png"), frames=(0, 2))
    job = farm.jobs.submit(request)
    assert [warning.code for warning in job.warnings] == ["no-effect"]
    assert "ease" in job.warnings[0].message and "explicit" in job.warnings[0].message


def test_every_fault_of_a_request_is_in_one_list(farm: Farm, tiny_clip: Path, tmp_path: Path) -> None:
    key = tmp_path / "keys.zip"
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        archive.writestr("0002.png", cv2.imencode(".png", np.zeros((40, 40, 3), np.uint8))[1].tobytes())
        archive.writestr("0099.png", cv2.imencode(".png", np.zeros((40, 40, 3), np.uint8))[1].tobytes())
    key.write_bytes(made.getvalue())
    ids = {"video": farm.assets.add(tiny_clip, "tiny.mp4").id, "masks": farm.assets.add(key, "keys.zip").id}
    request = JobRequest("analogy", ids, {"levels": 99}, output=OutputSpec(artefacts=("svg",)), frames=(3, 900))
    with pytest.raises(BadParameter) as refused:
        farm.jobs.submit(request)
    fields = {error.field for error in (refused.value, *refused.value.others)}
    assert fields == {"params.levels", "inputs.keyframes", "inputs.masks", "output.artefacts", "frames"}

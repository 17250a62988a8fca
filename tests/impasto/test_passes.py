"""Passes of methods by job, command, library and project: the same bytes on one and two workers."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from numpy.typing import NDArray

import impasto
from impasto import NoEffect, OutputFile
from impasto.cli.app import run
from pipeline.errors import BadInput, BadParameter
from pipeline.methods import method
from pipeline.methods.abstraction import plan
from pipeline.passes.made import PASSES
from tests.conftest import TINY_FRAMES
from workers.contract.record import ANY_OWNER, Job
from workers.contract.request import JobRequest, OutputSpec
from workers.farm import Farm, open_farm
from workers.settings import FarmSettings

ALL = tuple(one.name for one in method("abstraction").makes_passes)


@pytest.fixture(scope="module", params=[1, 2])
def farm(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Farm]:
    plan.RUN_FRAMES, usual = 7, plan.RUN_FRAMES
    opened = open_farm(FarmSettings(home=tmp_path_factory.mktemp("farm"), pool="local", workers=request.param))
    opened.start()
    yield opened
    opened.stop()
    plan.RUN_FRAMES = usual


def finished(farm: Farm, request: JobRequest) -> Job:
    job, last = farm.jobs.submit(request), 0
    while not farm.jobs.get(job.id).state.final:
        farm.jobs.wait_for_event(job.id, last, 5.0)
        last = max((event.seq for event in farm.jobs.events(job.id, last)[0]), default=last)
    done = farm.jobs.get(job.id)
    assert done.state == "succeeded", done.error
    return done


def file(farm: Farm, job: Job, name: str = PASSES) -> bytes:
    return b"".join(farm.files.read(farm.files.get(job.id, name)))


def channels(data: bytes) -> dict[str, NDArray[np.generic]]:
    with OpenEXR.File(io.BytesIO(data), separate_channels=True) as image:
        return {name: channel.pixels.copy() for name, channel in image.channels().items()}


KEPT: dict[str, bytes] = {}
"""Files of the farm with one worker."""


def same(name: str, data: bytes) -> None:
    """The files of both farms are equal."""
    assert KEPT.setdefault(name, data) == data


def test_a_job_has_a_layer_for_each_pass_and_the_film_of_a_job_without(farm: Farm, tiny_clip: Path) -> None:
    video = {"video": farm.assets.add(tiny_clip, "tiny.mp4").id}
    plain = finished(farm, JobRequest("abstraction", video, output=OutputSpec("png")))
    job = finished(farm, JobRequest("abstraction", video, output=OutputSpec("png", passes=ALL)))
    assert PASSES in job.results and PASSES not in plain.results and job.warnings == plain.warnings
    assert file(farm, job, "result") == file(farm, plain, "result")
    data = file(farm, job)
    same("exr", data)
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        assert archive.namelist() == [f"{index:05d}.exr" for index in range(TINY_FRAMES)]
        found = channels(archive.read("00009.exr"))
    assert {name.partition(".")[0] for name in found} == set(ALL)
    assert found["labels.ID"].dtype == np.uint32 and found["flow.X"].dtype == np.float32
    shape = (
        farm.assets.get(video["video"], ANY_OWNER).info["height"],
        farm.assets.get(video["video"], ANY_OWNER).info["width"],
    )
    assert {channel.shape for channel in found.values()} == {shape}


def test_passes_of_several_steps_come_in_one_image_and_of_a_piece_in_its_numbers(farm: Farm, tiny_clip: Path) -> None:
    video = {"video": farm.assets.add(tiny_clip, "tiny.mp4").id}
    wanted = ("flow", "tubes", "stroke-ids")
    job = finished(farm, JobRequest("multistyle", video, output=OutputSpec("png", passes=wanted), frames=(3, 6)))
    data = file(farm, job)
    same("piece", data)
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        assert archive.namelist() == ["00003.exr", "00004.exr", "00005.exr"]
        assert sorted(channels(archive.read("00004.exr"))) == ["flow.X", "flow.Y", "stroke-ids.ID", "tubes.ID"]


def test_passes_are_layers_in_the_images_of_the_film(farm: Farm, tiny_clip: Path, tmp_path: Path) -> None:
    """The picture and its attributes stay; the passes are those of a file of their own."""
    video, wanted = {"video": farm.assets.add(tiny_clip, "tiny.mp4").id}, ("labels", "flow")
    kinds = {"film": "film", "": "apart"}
    jobs = {
        kind: finished(
            farm, JobRequest("abstraction", video, output=OutputSpec("exr", passes=wanted, passes_format=form))
        )
        for form, kind in kinds.items()
    }
    assert PASSES in jobs["apart"].results and PASSES not in jobs["film"].results
    assert jobs["film"].warnings == jobs["apart"].warnings
    data = file(farm, jobs["film"], "result")
    same("film", data)
    archives = [zipfile.ZipFile(io.BytesIO(each)) for each in (data, file(farm, jobs["apart"], "result"),
                                                              file(farm, jobs["apart"]))]  # fmt: skip
    film, picture, passes = (archive.read(archive.namelist()[9]) for archive in archives)
    assert archives[0].namelist() == archives[1].namelist()
    found, apart = channels(film), channels(picture) | channels(passes)
    assert sorted(found) == ["B", "G", "R", "flow.X", "flow.Y", "labels.ID"]
    for name, values in apart.items():
        assert found[name].dtype == values.dtype
        np.testing.assert_array_equal(found[name], values)
    with OpenEXR.File(io.BytesIO(film)) as image:
        assert image.header()["colorInteropID"] == "lin_rec709_scene"
    impasto.render(
        "abstraction", tiny_clip, OutputFile(tmp_path / "own/f.####.exr", passes=wanted, passes_format="film")
    )
    assert (tmp_path / "own/f.0009.exr").read_bytes() == film and len(list((tmp_path / "own").iterdir())) == TINY_FRAMES


def test_layers_have_passes_of_their_own(farm: Farm, tiny_clip: Path) -> None:
    video = {"video": farm.assets.add(tiny_clip, "tiny.mp4").id}
    rows = [{"method": "abstraction"}, {"method": "abstraction", "params": {"flow": "dis-fast"}, "opacity": 0.5}]
    output = OutputSpec("png", passes=("layer0.labels", "layer1.labels", "layer1.flow"), passes_format="png")
    job = finished(farm, JobRequest("layers", video, {"layers": rows}, output=output, frames=(0, 2)))
    data = file(farm, job)
    same("layers", data)
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        assert archive.namelist() == [f"{name}/0000{k}.png" for name in sorted(output.passes) for k in (0, 1)]


@pytest.mark.parametrize(
    ("output", "field", "hint"),
    [
        (OutputSpec(passes=("flows",)), "output.passes", "flow, labels, regions"),
        (OutputSpec(passes=("flow",), passes_format="tiff"), "output.passes_format", "exr, png, film"),
        (OutputSpec("png", passes=("flow",), passes_format="film"), "output.passes_format", "format exr"),
        (OutputSpec(passes_format="png"), "output.passes", "Name passes: flow"),
    ],
)
def test_what_a_method_does_not_make_is_refused_with_the_list(
    farm: Farm, tiny_clip: Path, output: OutputSpec, field: str, hint: str
) -> None:
    video = {"video": farm.assets.add(tiny_clip, "tiny.mp4").id}
    with pytest.raises(BadParameter) as caught:
        farm.jobs.submit(JobRequest("abstraction", video, output=output))
    assert caught.value.field == field and hint in caught.value.remedy


def test_a_pass_that_has_no_effect_is_told(farm: Farm, tiny_clip: Path) -> None:
    video = {"video": farm.assets.add(tiny_clip, "tiny.mp4").id}
    output = OutputSpec(passes=("lines", "flow"))
    job = farm.jobs.submit(JobRequest("abstraction", video, {"lines": "off"}, output=output, frames=(0, 1)))
    (warning,) = farm.jobs.get(job.id).warnings
    assert "pass 'lines'" in warning.message and "lines = dog" in warning.message


# -- command and library


def command(capsys: pytest.CaptureFixture[str], home: Path, *words: str | Path, code: int = 0) -> dict[str, Any]:
    status = run(["render", *map(str, words), "--home", str(home), "--json"])
    output = capsys.readouterr()
    assert status == code, output
    last: dict[str, Any] = json.loads(output.out.splitlines()[-1])
    return last


def test_the_command_saves_passes_beside_the_film_or_in_a_folder(
    capsys: pytest.CaptureFixture[str], tiny_clip: Path, tmp_path: Path, home: Path
) -> None:
    words = (tiny_clip, "--frames", "2:5", "--passes", "flow, labels")
    told = command(capsys, home, *words, "-o", tmp_path / "film.mp4")
    assert told["artefacts"] == {PASSES: str(tmp_path / "film-passes.zip")}
    to = f"{tmp_path}/shot/p.####.exr"
    command(capsys, home, *words, "-o", tmp_path / "again.mp4", "--passes-to", to)
    with zipfile.ZipFile(tmp_path / "film-passes.zip") as archive:
        assert sorted(p.name for p in (tmp_path / "shot").iterdir()) == ["p.0002.exr", "p.0003.exr", "p.0004.exr"]
        assert (tmp_path / "shot" / "p.0003.exr").read_bytes() == archive.read("00003.exr")
    fault = command(capsys, home, *words, "-o", tmp_path / "film.mp4", "--passes-format", "png", code=2)
    assert fault["error"]["field"] == "--output", "what exists is not replaced"


@pytest.mark.parametrize(
    ("words", "field"),
    [
        (("--passes", "flows"), "output.passes"),
        (("--passes-to", "p.zip"), "--passes-to"),
        (("--passes", "flow", "--passes-format", "png", "--passes-to", "p/"), "--passes-to"),
        (("--passes", "flow", "--passes-to", "p.exr"), "--passes-to"),
        (("--passes", "flow", "--passes-format", "film"), "output.passes_format"),
        (("--passes", "flow", "--passes-format", "film", "--passes-to", "p.zip"), "--passes-to"),
    ],
)
def test_the_command_refuses_what_cannot_be_made(
    capsys: pytest.CaptureFixture[str], tiny_clip: Path, tmp_path: Path, home: Path, words: tuple[str, ...], field: str
) -> None:
    fault = command(capsys, home, tiny_clip, "-o", tmp_path / "film.mp4", *words, code=2)
    assert fault["error"]["field"] == field


def test_the_library_saves_the_bytes_of_the_command(
    capsys: pytest.CaptureFixture[str], tiny_clip: Path, tmp_path: Path, home: Path
) -> None:
    command(capsys, home, tiny_clip, "-o", tmp_path / "film.mp4", "--passes", "flow,lines")
    made = impasto.render("abstraction", tiny_clip, OutputFile(tmp_path / "own.mp4", passes=("lines", "flow")))
    assert made.exists()
    assert (tmp_path / "own-passes.zip").read_bytes() == (tmp_path / "film-passes.zip").read_bytes()
    with pytest.warns(NoEffect, match="pass 'lines'"):
        spec = OutputFile(tmp_path / "third.mp4", passes=("lines",), passes_format="png")
        impasto.render("abstraction", [np.full((32, 48, 3), 90, np.uint8)] * 2, spec, lines="off")
    with pytest.raises(BadInput, match="exist already"):
        (tmp_path / "own.mp4").unlink()
        impasto.render("abstraction", tiny_clip, OutputFile(tmp_path / "own.mp4", passes=("flow",)))
    with pytest.raises(BadParameter, match="no pass 'flows'"):
        impasto.render("abstraction", tiny_clip, OutputFile(tmp_path / "x.mp4", passes=("flows",)))

"""Formats, profiles and opacity by job, command and library: the same bytes on one and two workers."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import av
import cv2
import numpy as np
import OpenEXR
import pytest
from typer.testing import CliRunner

from impasto.cli.app import app
from impasto.delivery import deliver, target
from pipeline.arrays import AnyArray
from pipeline.errors import BadInput, BadParameter
from pipeline.formats import OUTPUTS
from pipeline.formats.decoding import decode_raw
from pipeline.methods import convert
from pipeline.video.media import Limits
from workers.contract.request import JobRequest, OutputSpec
from workers.farm import Farm, open_farm
from workers.settings import FarmSettings

SIZE = (320, 180)
COUNT = 7
"""Three tasks emit segments of at most three frames."""
Y, X = np.mgrid[: SIZE[1], : SIZE[0]]


@pytest.fixture(scope="module", params=[1, 2])
def farm(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Farm]:
    convert.RUN_FRAMES, usual = 3, convert.RUN_FRAMES
    opened = open_farm(FarmSettings(home=tmp_path_factory.mktemp("farm"), pool="local", workers=request.param))
    opened.start()
    yield opened
    opened.stop()
    convert.RUN_FRAMES = usual


def disc(index: int) -> AnyArray:
    clear = np.clip((60 - np.hypot(X - 100 - index, Y - 90)) / 12 + 0.5, 0, 1)
    shade = 90 + X % 80
    return np.dstack([np.full_like(X, 209), shade, np.full_like(X, 68), np.rint(clear * 255)]).astype(np.uint8)


def zipped(path: Path, count: int = COUNT, alpha: bool = True) -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        for index in range(count):
            stored = disc(index)[..., [2, 1, 0, 3] if alpha else [2, 1, 0]]
            archive.writestr(
                f"plate.{1001 + index}.png", cv2.imencode(".png", np.ascontiguousarray(stored))[1].tobytes()
            )
    return path


def result(farm: Farm, source: Path, output: OutputSpec, method: str = "convert") -> tuple[bytes, tuple[str, ...]]:
    """The film, and the codes of the job's warnings."""
    asset = farm.assets.add(source, source.name).id
    inputs = {"video": asset} | ({"film": asset} if method == "convert" else {})
    job, last_seq = farm.jobs.submit(JobRequest(method, inputs, output=output)), 0
    while not farm.jobs.get(job.id).state.final:
        farm.jobs.wait_for_event(job.id, last_seq, 5.0)
        last_seq = max((event.seq for event in farm.jobs.events(job.id, last_seq)[0]), default=last_seq)
    done = farm.jobs.get(job.id)
    assert done.state == "succeeded", done.error
    notes = tuple(str(warning.message) for warning in done.warnings)
    return b"".join(farm.files.read(farm.files.get(job.id, "result"))), notes


KEPT: dict[tuple[str, str], bytes] = {}
"""Films of the farm with one worker."""
MADE = [(form.name, each.name) for form in OUTPUTS.values() for each in form.profiles]
CODECS = {each.codec: (form.name, each.name) for form in OUTPUTS.values() for each in form.profiles}
ONCE = {*CODECS.values(), *((form.name, form.profiles[0].name) for form in OUTPUTS.values())}
"""(format, profile): every format and every codec at least once."""


def made_film(made: tuple[str, str], farm: Farm, folder: Path) -> bytes:
    film, notes = result(farm, zipped(folder / "plate.zip"), OutputSpec(made[0], 4, profile=made[1]))
    has_alpha = OUTPUTS[made[0]].profile(made[1]).has_alpha
    assert any("over white" in note for note in notes) != has_alpha
    return film


@pytest.mark.parametrize("made", [each for each in MADE if each in ONCE])
def test_a_job_makes_the_same_bytes_on_any_number_of_workers(made: tuple[str, str], farm: Farm, tmp_path: Path) -> None:
    film = made_film(made, farm, tmp_path)
    assert KEPT.setdefault(made, film) == film


@pytest.mark.parametrize("farm", [1], indirect=True)
@pytest.mark.parametrize("made", [each for each in MADE if each not in ONCE])
def test_a_job_makes_every_other_profile(made: tuple[str, str], farm: Farm, tmp_path: Path) -> None:
    assert made_film(made, farm, tmp_path)


def test_a_zip_keeps_numbers_and_opacity(farm: Farm, tmp_path: Path) -> None:
    film, notes = result(farm, zipped(tmp_path / "plate.zip"), OutputSpec("png", profile="16"))
    with zipfile.ZipFile(io.BytesIO(film)) as archive:
        assert archive.namelist()[:2] == ["1001.png", "1002.png"] and len(archive.namelist()) == COUNT
        for index in (0, COUNT - 1):
            data = np.frombuffer(archive.read(archive.namelist()[index]), np.uint8)
            got = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
            assert (got.dtype, got.shape[2]) == (np.uint16, 4)
            np.testing.assert_array_equal(got[..., 3] // 257, disc(index)[..., 3])
    assert not notes


def test_opacity_can_be_refused_and_is_missed_by_name(farm: Farm, tmp_path: Path) -> None:
    source = zipped(tmp_path / "plate.zip", 3)
    film, notes = result(farm, source, OutputSpec("png", alpha="none"))
    with zipfile.ZipFile(io.BytesIO(film)) as archive:
        assert decode_raw(archive.read("1001.png"), Limits()).shape[2] == 3
    assert any("over white" in note for note in notes)
    opaque = zipped(tmp_path / "opaque.zip", 3, alpha=False)
    for output in (
        OutputSpec("mp4", alpha="source"),
        OutputSpec("png", alpha="painted"),
        OutputSpec("mov", profile="x"),
    ):
        with pytest.raises(BadParameter, match="output") as caught:
            result(farm, opaque, output)
        assert caught.value.remedy


def test_a_painted_film_has_the_source_s_opacity(farm: Farm, tmp_path: Path) -> None:
    film, _notes = result(farm, zipped(tmp_path / "plate.zip", 3), OutputSpec("exr"), method="abstraction")
    with zipfile.ZipFile(io.BytesIO(film)) as archive, OpenEXR.File(io.BytesIO(archive.read("1002.exr"))) as file:
        pixels = file.channels()["RGBA"].pixels.astype(np.float32)
    np.testing.assert_allclose(pixels[..., 3], disc(1)[..., 3] / 255, atol=1e-3)
    edge = (pixels[..., 3] > 0.2) & (pixels[..., 3] < 0.8)
    straight = pixels[edge][:, 0] / pixels[edge][:, 3]
    assert 0.4 < np.median(straight) < 0.8  # the disc's red, 0.64: neither white nor black is painted into the edge


def test_names_of_outputs(tmp_path: Path) -> None:
    for text, form, wanted in (
        ("film.mov", "", ("mov", "file", "")), ("film.zip", "exr", ("exr", "file", "")),
        ("frame.tiff", "", ("tiff", "still", "")), ("comp/", "exr", ("exr", "frames", "####.exr")),
        ("comp/", "", ("png", "frames", "####.png")), ("comp/a.%05d.tif", "", ("tiff", "frames", "a.%05d.tif")),
    ):  # fmt: skip
        found = target(str(tmp_path / text) + ("/" if text.endswith("/") else ""), form=form)
        assert (found.format, found.kind, found.pattern) == wanted
    for text, form in (("film.mp4", "mov"), ("comp/", "mp4"), ("film.avi", "")):
        with pytest.raises(BadInput) as caught:
            target(str(tmp_path / text) + ("/" if text.endswith("/") else ""), form=form)
        assert caught.value.remedy


def test_frames_are_delivered_by_the_pattern(tmp_path: Path) -> None:
    source = tmp_path / "result.zip"
    with zipfile.ZipFile(source, "w") as archive:
        for name in ("1001.exr", "1002.exr", "-0003.exr", "sequence.json"):
            archive.writestr(name, name)
    deliver(source, target(str(tmp_path / "comp/plate_v001.####.exr")))
    names = sorted(path.name for path in (tmp_path / "comp").iterdir())
    assert names == ["plate_v001.-0003.exr", "plate_v001.1001.exr", "plate_v001.1002.exr"]
    with pytest.raises(BadInput):
        target(str(tmp_path / "comp/other.####.exr"))


def test_the_command_lists_formats() -> None:
    listed = json.loads(CliRunner().invoke(app, ["formats", "--json"]).stdout)
    mov = next(form for form in listed if form["name"] == "mov")
    assert {"422hq", "4444", "dnxhr-hqx"} <= {profile["name"] for profile in mov["profiles"]}
    assert "dnxhr-hqx" in CliRunner().invoke(app, ["formats"]).stdout


def test_the_library_writes_a_profile_with_opacity(tmp_path: Path) -> None:
    import impasto

    folder = tmp_path / "plate"
    folder.mkdir()
    with zipfile.ZipFile(zipped(tmp_path / "plate.zip", 3)) as archive:
        archive.extractall(folder)
    out = impasto.render("abstraction", folder, impasto.OutputFile(tmp_path / "film.mov", "4444"), lines="off")
    with av.open(str(out)) as container:
        shown = next(container.decode(video=0))
        assert shown.format.name == "yuva444p12le"
        matte = shown.reformat(format="rgba").to_ndarray()[..., 3]
    assert np.abs(matte.astype(int) - disc(0)[..., 3]).max() <= 1
    with pytest.raises(BadParameter):
        impasto.render("abstraction", folder, impasto.OutputFile(tmp_path / "film.mp4", alpha="source"))


def test_the_profile_is_part_of_what_a_task_is_reused_for() -> None:
    from tests.workers.test_child_runner import order  # any order
    from workers.execution.reuse import signature

    one = order(1)
    assert signature(one) != signature(replace(one, output=replace(one.output, format="mov", profile="4444")))

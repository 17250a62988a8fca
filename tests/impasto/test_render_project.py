"""`impasto render project.zip` gives the bytes of the service's job."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from impasto.cli import project_film, rendering
from impasto.cli.app import app
from impasto.cli.console import Interrupted
from pipeline.errors import BadInput
from pipeline.video.probe import probe
from tests.pipeline.video.making import make_video
from workers.farm import Farm, open_farm
from workers.projects.archive import write_archive
from workers.settings import FarmSettings

STROKES: dict[str, Any] = {
    "id": "l1", "method": "multistyle", "params": {"style": "pointillism"}, "seed": 5,
    "parts": {
        "design": {
            "regions": {"left": {"polygons": [{"frame": 0, "points": [[0, 0], [0.5, 0], [0.5, 1], [0, 1]]}]}},
            "keys": [{"region": "left", "frame": 2, "set": {"size": 40}}],
        }
    },
}  # fmt: skip
SHOTS: dict[str, dict[str, Any]] = {
    "one layer": {"layers": [STROKES]},
    "a piece": {"layers": [STROKES], "range": [3, 11]},
    "layers": {
        "layers": [
            {"id": "l0", "method": "abstraction"},
            {**STROKES, "opacity": 0.6, "blend": "multiply"},
            {"id": "l2", "method": "abstraction", "params": {"lines": "off"}, "visible": False},
        ],
        "range": [3, 11],
    },
}


@pytest.fixture(scope="module")
def farm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Farm]:
    opened = open_farm(FarmSettings(home=tmp_path_factory.mktemp("home"), pool="local", workers=2))
    opened.start()
    yield opened
    opened.stop()


def _document(clip: str, shot: dict[str, Any]) -> dict[str, Any]:
    assets = {"clip": {"id": clip}}
    shots = [{"id": "s1", "video": "clip", **shot}]
    return {"schema": 2, "name": "Swan", "assets": assets, "output": {"quality": 12}, "shots": shots}


def _film_of_service(farm: Farm, project: str) -> bytes:
    (made,) = farm.projects.submit(project)
    _finished(farm, made.job.id)
    return b"".join(farm.files.read(farm.files.get(made.job.id, "result")))


def _finished(farm: Farm, job: str) -> None:
    last_seq = 0
    while not farm.jobs.get(job).state.final:
        farm.jobs.wait_for_event(job, last_seq, 5.0)
        last_seq = max((event.seq for event in farm.jobs.events(job, last_seq)[0]), default=last_seq)
    assert farm.jobs.get(job).state == "succeeded", farm.jobs.get(job).error


@pytest.mark.parametrize("name", SHOTS)
def test_a_rendered_project_has_the_bytes_of_the_service(
    farm: Farm, tiny_clip: Path, tmp_path: Path, name: str
) -> None:
    project = farm.projects.create(_document(farm.assets.add(tiny_clip, "tiny.mp4").id, SHOTS[name]), "")
    film = _film_of_service(farm, project.id)
    archive, out = tmp_path / "project.zip", tmp_path / "film.mp4"
    farm.projects.export(project.id, archive)
    found = CliRunner().invoke(app, ["render", str(archive), "-o", str(out), "--home", str(tmp_path), "--quiet"])
    assert found.exit_code == 0, found.output
    assert hashlib.sha256(out.read_bytes()).hexdigest() == hashlib.sha256(film).hexdigest()
    first, end = SHOTS[name].get("range", (0, 24))
    assert probe(out).frames == end - first


FORMER = {
    "id": "l1", "method": "multistyle", "params": {"style": "pointillism"}, "seed": 5,
    "regions": STROKES["parts"]["design"]["regions"], "style_keys": STROKES["parts"]["design"]["keys"],
}  # fmt: skip


def test_a_project_that_was_exported_in_schema_1_is_imported_and_rendered_to_the_same_bytes(
    farm: Farm, tiny_clip: Path, tmp_path: Path
) -> None:
    """The archive is that of version 0f33145d: since then only the schema of its document has changed."""
    clip = farm.assets.add(tiny_clip, "tiny.mp4")
    films = []
    for schema, layer in ((1, FORMER), (2, STROKES)):
        document = {**_document(clip.id, {"layers": [layer], "range": [3, 7]}), "schema": schema}
        archive, out = tmp_path / f"project-{schema}.zip", tmp_path / f"film-{schema}.mp4"
        write_archive(archive, document, {clip.id: clip}, lambda asset_id: iter([tiny_clip.read_bytes()]))
        words = ["render", str(archive), "-o", str(out), "--home", str(tmp_path / str(schema)), "--quiet"]
        assert CliRunner().invoke(app, words).exit_code == 0
        loaded = farm.projects.load(archive, "", 1 << 30)
        assert farm.projects.document(loaded.id)[1] == {**document, "schema": 2, "shots": [
            {"id": "s1", "video": "clip", "layers": [STROKES], "range": [3, 7]}
        ]}  # fmt: skip
        films.append(out.read_bytes())
    assert films[0] == films[1]


def _film(farm: Farm, clips: dict[str, str]) -> str:
    """A project of four shots of these clips, two of them equal; the project's id."""
    shots = [
        {"id": "s1", "video": "long", "range": [2, 6], "layers": [{"id": "l1", "method": "abstraction"}]},
        {"id": "s2", "video": "short", "layers": [{**STROKES, "id": "l2"}]},
        {"id": "s3", "video": "long", "range": [2, 6], "layers": [{"id": "l3", "method": "abstraction"}]},
        {"id": "s4", "video": "long", "range": [0, 3], "layers": [{"id": "l4", "method": "abstraction", "seed": 2}]},
    ]
    document = {"schema": 2, "name": "Film", "output": {"quality": 14}, "shots": shots}
    document["assets"] = {name: {"id": asset} for name, asset in clips.items()}
    return farm.projects.create(document, "").id


@pytest.fixture(scope="module")
def project_zip(farm: Farm, tiny_clip: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bytes]:
    """A project of four shots with sound, of clips of two sizes, and its film as the service makes it."""
    folder = tmp_path_factory.mktemp("film")
    small = make_video(folder / "small.mp4", [np.full((64, 64, 3), 40 * k, np.uint8) for k in range(5)])
    clips = {"long": farm.assets.add(tiny_clip, "tiny.mp4").id, "short": farm.assets.add(small, "small.mp4").id}
    project = _film(farm, clips)
    for made in farm.projects.submit(project, changed=True):
        _finished(farm, made.job.id)
    archive = folder / "project.zip"
    farm.projects.export(project, archive)
    return archive, b"".join(farm.files.read(farm.films.file(project)))


def test_all_shots_are_rendered_and_joined_to_the_bytes_of_the_service(
    project_zip: tuple[Path, bytes], tmp_path: Path
) -> None:
    archive, film = project_zip
    out = tmp_path / "film.mp4"
    found = CliRunner().invoke(app, ["render", str(archive), "-o", str(out), "--home", str(tmp_path), "--json"])
    assert found.exit_code == 0, found.output
    summary = json.loads(found.stdout)
    assert (summary["frames"], [shot["frames"] for shot in summary["shots"]]) == (16, [4, 5, 4, 3])
    assert hashlib.sha256(out.read_bytes()).hexdigest() == hashlib.sha256(film).hexdigest()
    assert next(warning["message"] for warning in summary["warnings"]).startswith(
        "The film has the size of its first shot, 96x64 px"
    )
    assert probe(out).has_audio
    assert not list((tmp_path / "renders").glob("*")), "nothing of a finished render stays"


def test_the_command_of_a_shell_renders_all_shots(project_zip: tuple[Path, bytes], tmp_path: Path) -> None:
    """Only a real command is watched by another process, and sends it a pulse during all shots."""
    archive, film = project_zip
    out = tmp_path / "film.mp4"
    words = ["render", str(archive), "-o", str(out), "--home", str(tmp_path), "--quiet"]
    done = subprocess.run([sys.executable, "-m", "impasto", *words], capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr
    assert out.read_bytes() == film


@pytest.mark.parametrize(
    "options", [["--method", "abstraction"], ["--param", "lines=off"], ["--quality", "20"], ["--fps", "12"],
                ["--sound-track", "0"], ["--colour-out", "PQ"], ["--raw", "9x9"]],
)  # fmt: skip
def test_what_the_project_decides_is_refused(
    project_zip: tuple[Path, bytes], tmp_path: Path, options: list[str]
) -> None:
    words = ["render", str(project_zip[0]), "-o", str(tmp_path / "film.mp4"), "--home", str(tmp_path), *options]
    error = CliRunner().invoke(app, words).exception
    assert isinstance(error, BadInput) and error.field == options[0]


def test_shots_that_differ_are_refused_before_the_work_in_a_format_that_would_lose(
    project_zip: tuple[Path, bytes], tmp_path: Path
) -> None:
    words = ["render", str(project_zip[0]), "-o", str(tmp_path / "film.mov"), "--home", str(tmp_path)]
    error = CliRunner().invoke(app, words).exception
    assert isinstance(error, BadInput) and error.field == "output.profile"
    assert not (tmp_path / "renders").exists(), "nothing was painted"


def test_one_shot_of_a_project_is_rendered(project_zip: tuple[Path, bytes], tmp_path: Path) -> None:
    archive, _film = project_zip
    out = tmp_path / "shot.mp4"
    words = ["render", str(archive), "-o", str(out), "--home", str(tmp_path), "--quiet"]
    assert CliRunner().invoke(app, [*words, "--shot", "4", "--frames", "1:3"]).exit_code == 0
    assert probe(out).frames == 2


@pytest.mark.parametrize(
    ("options", "field", "remedy"),
    [
        (["--shot", "5"], "--shot", "It has 4 shots"),
        (["--frames", "0:2"], "--frames", "Add --shot N"),
        (["--artefact", "svg"], "--artefact", "Add --shot N"),
        (["-o", "frames/"], "--output", "or add --shot N"),
    ],
)
def test_what_is_for_one_shot_is_refused_for_a_film(
    project_zip: tuple[Path, bytes], tmp_path: Path, options: list[str], field: str, remedy: str
) -> None:
    words = ["render", str(project_zip[0]), "-o", str(tmp_path / "film.mp4"), "--home", str(tmp_path), *options]
    error = CliRunner().invoke(app, words).exception
    assert isinstance(error, BadInput)
    assert error.field == field
    assert remedy in error.remedy


def test_frames_of_a_shot_are_numbers_of_its_images(farm: Farm, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "shot.zip", "w") as images:
        for number in range(1001, 1006):
            picture = cv2.imencode(".png", np.full((48, 64, 3), number % 200, np.uint8))[1]
            images.writestr(f"{number}.png", picture.tobytes())
    asset = farm.assets.add(tmp_path / "shot.zip", "shot.zip")
    project = farm.projects.create(_document(asset.id, {"layers": [{"id": "l1", "method": "abstraction"}]}), "")
    archive = tmp_path / "project.zip"
    farm.projects.export(project.id, archive)
    words = ["render", str(archive), "-o", f"{tmp_path}/out/", "--home", str(tmp_path / "home"), "--frames"]
    assert CliRunner().invoke(app, [*words, "#1002-#1003"]).exit_code == 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["1002.png", "1003.png"]
    error = CliRunner().invoke(app, [*words, "01:00:00:00-01:00:00:02"]).exception
    assert isinstance(error, BadInput) and "no timecode" in error.message


def test_a_project_is_no_video(project_zip: tuple[Path, bytes], tmp_path: Path) -> None:
    error = CliRunner().invoke(app, ["inspect", str(project_zip[0])]).exception
    assert isinstance(error, BadInput) and "exported project" in error.message


def test_an_interrupted_film_continues_with_the_shots_that_are_missing(
    project_zip: tuple[Path, bytes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    archive, film = project_zip
    out = tmp_path / "film.mp4"
    words = ["render", str(archive), "-o", str(out), "--home", str(tmp_path), "--quiet"]
    painted: list[str] = []

    def interrupted(order: rendering.RenderOrder, *how: Any) -> dict[str, Any]:
        if painted == ["Film: s1", "Film: s2"]:
            raise Interrupted("Interrupted at 10%.", remedy="Run the same command again to resume.")
        painted.append(order.request.name)
        return rendering.run(order, *how)

    monkeypatch.setattr(project_film, "run", interrupted)
    assert isinstance(CliRunner().invoke(app, words).exception, Interrupted)
    assert not out.exists()
    painted.clear()
    assert CliRunner().invoke(app, words).exit_code == 0
    assert painted == ["Film: s4"], "shots 1 and 2 are taken over, and shot 3 shows what shot 1 shows"
    assert out.read_bytes() == film


def test_an_estimate_of_a_film_is_that_of_all_its_shots(project_zip: tuple[Path, bytes], tmp_path: Path) -> None:
    found = CliRunner().invoke(
        app, ["render", str(project_zip[0]), "--estimate", "--json", "--home", str(tmp_path / "home")]
    )
    assert found.exit_code == 0, found.output
    assert json.loads(found.stdout)["frames"] == 16

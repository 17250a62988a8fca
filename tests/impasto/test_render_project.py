"""`impasto render project.zip`: the bytes that the service's job gives."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from impasto.cli.app import app
from workers.farm import open_farm
from workers.settings import FarmSettings


def _document(clip: str) -> dict[str, Any]:
    layer = {
        "id": "l1", "method": "multistyle", "params": {"style": "pointillism"}, "seed": 5,
        "regions": {"left": {"polygons": [{"frame": 0, "points": [[0, 0], [0.5, 0], [0.5, 1], [0, 1]]}]}},
        "style_keys": [{"region": "left", "frame": 2, "set": {"size": 40}}],
    }  # fmt: skip
    return {
        "schema": 1, "name": "Swan", "assets": {"clip": {"id": clip}}, "output": {"quality": 12},
        "shots": [{"id": "s1", "video": "clip", "layers": [layer]}],
    }  # fmt: skip


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory, tiny_clip: Path) -> tuple[Path, str]:
    """A project's archive, and the SHA-256 of the film that the service's job makes of it."""
    home = tmp_path_factory.mktemp("home")
    farm = open_farm(FarmSettings(home=home, pool="local", workers=2))
    farm.start()
    try:
        project = farm.projects.create(_document(farm.assets.add(tiny_clip, "tiny.mp4").id), "")
        (made,) = farm.projects.submit(project.id)
        last_seq = 0
        while not farm.jobs.get(made.job.id).state.final:
            farm.jobs.wait_for_event(made.job.id, last_seq, 5.0)
            last_seq = max((event.seq for event in farm.jobs.events(made.job.id, last_seq)[0]), default=last_seq)
        assert farm.jobs.get(made.job.id).state == "succeeded", farm.jobs.get(made.job.id).error
        film = b"".join(farm.files.read(farm.files.get(made.job.id, "result")))
        farm.projects.export(project.id, home / "project.zip")
    finally:
        farm.stop()
    return home / "project.zip", hashlib.sha256(film).hexdigest()


def test_the_film_has_the_bytes_of_the_service(exported: tuple[Path, str], tmp_path: Path) -> None:
    out = tmp_path / "film.mp4"
    found = CliRunner().invoke(app, ["render", str(exported[0]), "-o", str(out), "--home", str(tmp_path), "--quiet"])
    assert found.exit_code == 0, found.output
    assert hashlib.sha256(out.read_bytes()).hexdigest() == exported[1]

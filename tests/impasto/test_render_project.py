"""`impasto render project.zip` gives the bytes of the service's job."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from impasto.cli.app import app
from pipeline.video.probe import probe
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
    last_seq = 0
    while not farm.jobs.get(made.job.id).state.final:
        farm.jobs.wait_for_event(made.job.id, last_seq, 5.0)
        last_seq = max((event.seq for event in farm.jobs.events(made.job.id, last_seq)[0]), default=last_seq)
    assert farm.jobs.get(made.job.id).state == "succeeded", farm.jobs.get(made.job.id).error
    return b"".join(farm.files.read(farm.files.get(made.job.id, "result")))


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

"""One film in seven ways: command, pipe, library, iterator, service, project, live. The same frames, or a refusal."""

from __future__ import annotations

import io
import json
import time
import zipfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from fastapi.testclient import TestClient
from typer.testing import CliRunner

from impasto.cli.app import app
from pipeline.frames import Frame
from pipeline.methods import methods
from service.app import create_app
from service.settings import Settings
from tests.laws import ways
from tests.laws.cases import Case
from workers.farm import open_farm
from workers.settings import FarmSettings

Frames = ways.Frames
CASES = [
    Case(1, "abstraction", {"line_colour": "#204060"}, ("importance",), 6, 0, (2, 4)),
    Case(1, "multistyle", {"style": "watercolor"}, ("design",), 6, 0, (2, 4)),
    Case(1, "patches", {"style": "circles"}, ("styles",), 6, 0, (2, 4)),
    Case(1, "analogy", {}, ("keyframes",), 6, 0, (2, 4)),
    Case(1, "steady", {"strength": 80.0}, ("styled",), 6, 0, (2, 4)),
    Case(1, "abstraction", {}, (), 6, 0, (2, 4)),
    Case(1, "multistyle", {"effect": "emphasis"}, (), 6, 0, (2, 4)),
]


def _zipped(pictures: Mapping[int, Any]) -> bytes:
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as archive:
        for number, picture in pictures.items():
            stored = picture[..., ::-1] if picture.ndim == 3 else picture
            archive.writestr(f"{number:04d}.png", cv2.imencode(".png", stored)[1].tobytes())
    return made.getvalue()


def _unzipped(data: bytes) -> Frames:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        names = sorted(archive.namelist())
        encoded = [np.frombuffer(archive.read(name), np.uint8) for name in names]
    return {index: np.asarray(cv2.imdecode(one, cv2.IMREAD_COLOR_RGB), np.uint8) for index, one in enumerate(encoded)}


def _files(case: Case, folder: Path) -> dict[str, Path]:
    """The video and the inputs as files."""
    found = {"video": folder / "video.zip"}
    found["video"].write_bytes(_zipped(dict(enumerate(case.film()))))
    for spec in case.chosen.inputs:
        if spec.name in case.inputs:
            given: Any = case.given()[spec.name]
            path = found[spec.name] = folder / f"{spec.name}.{'json' if spec.kind == 'json' else 'zip'}"
            numbered = given if isinstance(given, dict) else dict(enumerate(given)) if spec.kind != "json" else {}
            path.write_bytes(json.dumps(given).encode() if spec.kind == "json" else _zipped(numbered))
    return found


def _options(case: Case, files: Mapping[str, Path]) -> list[str]:
    inputs = [part for name in case.inputs for part in ("-i", f"{name}={files[name]}")]
    params = [part for name, value in case.params.items() for part in ("-p", f"{name}={value}")]
    return ["--method", case.method, "--seed", str(case.seed), *inputs, *params]


def command(case: Case, folder: Path, client: TestClient) -> Frames:
    files, out = _files(case, folder), folder / "film.zip"
    words = ["render", str(files["video"]), "-o", str(out), "--home", str(folder), *_options(case, files)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    return _unzipped(out.read_bytes())


def pipe(case: Case, folder: Path, client: TestClient) -> Frames:
    files, (width, height) = _files(case, folder), case.size
    words = ["render", "-", "-o", "-", "--raw", f"{width}x{height}", *_options(case, files)]
    raw = b"".join(frame.tobytes() for frame in case.film())
    done = CliRunner().invoke(app, words, input=raw)  # tests/impasto/test_pipes.py has pipes of a process
    assert done.exit_code == 0, done.stderr
    frames = np.frombuffer(done.stdout_bytes, np.uint8).reshape(-1, height, width, 3)
    return dict(enumerate(np.array(frames)))


def library(case: Case, folder: Path, client: TestClient) -> Frames:
    return ways.library(case)


def iterator(case: Case, folder: Path, client: TestClient) -> Frames:
    return ways.iterator(case)


def service(case: Case, folder: Path, client: TestClient) -> Frames:
    ids = _uploaded(client, _files(case, folder))
    body = {"method": case.method, "inputs": ids, "params": case.params, "seed": case.seed}
    made = client.post("/v1/jobs", json={**body, "output": {"format": "png"}})
    assert made.status_code == 201, made.text
    return _painted(client, made.json()["id"])


def project(case: Case, folder: Path, client: TestClient) -> Frames:
    ids = _uploaded(client, _files(case, folder))
    layer: dict[str, Any] = {"id": "l1", "method": case.method, "params": case.params, "seed": case.seed}
    layer["inputs"] = {name: name for name in case.inputs}
    shot = {"id": "s1", "video": "video", "layers": [layer]}
    assets = {name: {"id": asset} for name, asset in ids.items()}
    output = {"format": "png"}
    document = {"schema": 1, "name": "Film", "assets": assets, "output": output, "shots": [shot]}
    made = client.post("/v1/projects", json={"document": document})
    assert made.status_code == 201, made.text
    jobs = client.post(f"/v1/projects/{made.json()['id']}/jobs", json={})
    assert jobs.status_code == 201, jobs.text
    return _painted(client, jobs.json()["items"][0]["job"]["id"])


def live(case: Case, folder: Path, client: TestClient) -> Frames | None:
    """None: live refuses the case by the name of an input or parameter."""
    return ways.live(case) if ways.is_live(case) else None


Way = Callable[[Case, Path, TestClient], Frames | None]
"""Paints a case: with files in an empty folder, and a service's client."""
WAYS: tuple[Way, ...] = (command, pipe, library, iterator, service, project, live)


def _uploaded(client: TestClient, files: Mapping[str, Path]) -> dict[str, str]:
    found = {}
    for name, path in files.items():
        made = client.post("/v1/assets", files={"file": (path.name, path.read_bytes())})
        assert made.status_code in (200, 201), made.text
        found[name] = str(made.json()["id"])
    return found


def _painted(client: TestClient, job: str) -> Frames:
    end = time.monotonic() + 240
    while (found := client.get(f"/v1/jobs/{job}").json())["state"] not in ("succeeded", "failed", "cancelled"):
        assert time.monotonic() < end, found
        time.sleep(0.1)
    assert found["state"] == "succeeded", found["error"]
    return _unzipped(client.get(f"/v1/jobs/{job}/result").content)


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    """A client of a service with a farm of one worker."""
    home = tmp_path_factory.mktemp("farm")
    farm = open_farm(FarmSettings(home=home, pool="local", workers=1))
    farm.start()
    with TestClient(create_app(Settings(home=home), farm), "http://127.0.0.1:8420") as made:
        yield made
    farm.stop()


@pytest.fixture(scope="module")
def films() -> Iterator[dict[int, Frames]]:
    yield {number: ways.film(case) for number, case in enumerate(CASES)}


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.__name__)
@pytest.mark.parametrize("number", range(len(CASES)), ids=lambda number: f"{CASES[number].method}-{number}")
def test_every_way_gives_the_same_frames(
    films: dict[int, Frames], number: int, way: Way, tmp_path: Path, client: TestClient
) -> None:
    found: dict[int, Frame] | None = way(CASES[number], tmp_path, client)
    assert found is None or ways.difference(films[number], found) == 0


def test_every_method_is_among_the_cases() -> None:
    assert {case.method for case in CASES} == set(methods())

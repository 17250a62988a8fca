"""The command, the library call and the service report a damaged source."""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

import impasto
from impasto.cli.app import run
from impasto.cli.piping import PipeOrder
from impasto.sources import DamagedSource
from pipeline.errors import DamagedMedia
from service.app import create_app
from service.settings import Settings
from tests.pipeline.video.making import make_video, picture
from workers.contract.request import JobRequest
from workers.farm import Farm, open_farm
from workers.settings import FarmSettings
from workers.store.records import request_of, request_to_json

FRAMES = 24
CUT = "The source is damaged: frames 11-23 of 24 are missing."
UNREADABLE = "The source is damaged: frames 8-10 of 24 are unreadable."


def whole(path: Path) -> Path:
    return make_video(path, [picture(i) for i in range(FRAMES)], "mjpeg", "yuvj420p")


@pytest.fixture
def cut(tmp_path: Path) -> Path:
    """A Matroska file of 24 frames that ends after the first eleven."""
    path = whole(tmp_path / "cut.mkv")
    data = path.read_bytes()
    pictures = [at for at in range(len(data)) if data[at : at + 3] == b"\xff\xd8\xff"]
    path.write_bytes(data[: pictures[11] + 5])
    return path


@pytest.fixture
def holes(tmp_path: Path) -> Path:
    """An AVI file of 24 frames, three of which, in the middle, are replaced by noise."""
    path = whole(tmp_path / "holes.avi")
    data = bytearray(path.read_bytes())
    pictures = [at for at in range(len(data)) if data[at : at + 3] == b"\xff\xd8\xff"]
    noise = np.random.Generator(np.random.Philox(1))
    for number in (8, 9, 10):
        start, stop = pictures[number], pictures[number + 1] - 16
        data[start:stop] = noise.bytes(stop - start)
    path.write_bytes(bytes(data))
    return path


def render(capsys: pytest.CaptureFixture[str], home: Path, *words: str | Path) -> tuple[int, str, dict[str, Any]]:
    """Run `impasto render`; exit status, stderr and the JSON output."""
    capsys.readouterr()
    common = ["--param", "lines=off", "--home", home, "--json", "--quiet"]
    code = run([str(word) for word in ("render", *words, *common)])
    printed = capsys.readouterr()
    return code, printed.err, json.loads(printed.out.splitlines()[-1])


@pytest.mark.parametrize(("name", "message", "frames"), [("cut", CUT, 11), ("holes", UNREADABLE, FRAMES)])
def test_the_command_warns_or_fails(
    name: str, message: str, frames: int, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str],
    home: Path, tmp_path: Path,
) -> None:  # fmt: skip
    source: Path = request.getfixturevalue(name)
    code, text, summary = render(capsys, home, source, "-o", tmp_path / "out.mp4")
    assert (code, summary["frames"]) == (0, frames)
    assert f"warning: {message}" in text
    assert [(each["code"], each["message"]) for each in summary["warnings"]] == [("damaged-input", message)]
    code, text, summary = render(capsys, home, source, "-o", tmp_path / "no.mp4", "--on-damage", "fail")
    assert (code, summary["error"]["code"]) == (2, "damaged-media")
    assert "damaged" in text and not (tmp_path / "no.mp4").exists()


def test_the_command_does_not_warn_about_an_intact_source(
    capsys: pytest.CaptureFixture[str], home: Path, tmp_path: Path
) -> None:
    source = whole(tmp_path / "whole.avi")
    code, text, summary = render(capsys, home, source, "-o", tmp_path / "out.mp4", "--on-damage", "fail")
    assert (code, summary["warnings"]) == (0, []) and "warning" not in text


@pytest.mark.parametrize(
    ("name", "message", "method"),
    [("cut", CUT, "abstraction"), ("holes", UNREADABLE, "abstraction"), ("holes", UNREADABLE, "patches")],
)
def test_the_library_warns_or_raises(name: str, message: str, method: str, request: pytest.FixtureRequest) -> None:
    source: Path = request.getfixturevalue(name)
    with pytest.warns(DamagedSource, match=message) as caught:
        frames = list(impasto.render(method, source, **({"lines": "off"} if method == "abstraction" else {})))
    assert len(caught) == 1 and len(frames) in (11, FRAMES)
    with warnings.catch_warnings(), pytest.raises(DamagedSource, match="The source is damaged"):
        warnings.simplefilter("error", DamagedSource)
        list(impasto.render(method, source, **({"lines": "off"} if method == "abstraction" else {})))


def test_a_pipe_fails_at_its_end_if_asked_to(cut: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def order(output: Path, on_damage: str) -> PipeOrder:
        return PipeOrder(str(cut), str(output), "abstraction", {"lines": "off"}, {}, 0, 20, False, "", on_damage)

    order(tmp_path / "warned.mp4", "warn").run()
    assert re.search(CUT, capsys.readouterr().err)
    with pytest.raises(DamagedMedia, match=CUT):
        order(tmp_path / "failed.mp4", "fail").run()


def test_the_library_does_not_warn_about_an_intact_source(tmp_path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(list(impasto.render("abstraction", whole(tmp_path / "w.mkv"), lines="off"))) == FRAMES


@pytest.fixture
def farm(tmp_path: Path) -> Iterator[Farm]:
    made = open_farm(FarmSettings(home=tmp_path / "farm", pool="local", workers=1, reserve_bytes=0))
    made.start()
    yield made
    made.stop()


def test_a_job_of_the_service_has_a_warning_and_an_event(farm: Farm, holes: Path, cut: Path, tmp_path: Path) -> None:
    with TestClient(create_app(Settings(home=tmp_path / "farm"), farm), "http://127.0.0.1:8420") as client:
        assets = {}
        for path in (holes, cut):
            sent = client.post("/v1/assets", files={"file": (path.name, path.read_bytes())}).json()
            assets[path.name] = sent["id"]
        assert sent["info"]["damage"] == "The file is damaged: frames 11-23 of 24 are missing."
        body = {"method": "abstraction", "inputs": {"video": assets["holes.avi"]}, "params": {"lines": "off"}}
        ids = [client.post("/v1/jobs", json=body | more).json()["id"] for more in ({}, {"on_damage": "fail"})]
        refused = client.post("/v1/jobs", json=body | {"inputs": {"video": sent["id"]}, "on_damage": "fail"})
        assert (refused.status_code, refused.json()["code"]) == (422, "damaged-media")
        warned, failed = [_final(client, farm, job_id) for job_id in ids]
    assert warned["state"] == "succeeded" and [each["message"] for each in warned["warnings"]] == [UNREADABLE]
    assert warned["warnings"][0]["damage"] == {"frames": 24, "unreadable": [[8, 11]], "missing": []}
    events, _ = farm.jobs.events(warned["id"])
    assert [event.data["message"] for event in events if event.type == "job.warning"] == [UNREADABLE]
    assert (failed["state"], failed["error"]["code"]) == ("failed", "damaged-media")
    assert failed["counts"]["succeeded"] == 0, "it fails at the scan, before anything is painted"


def test_a_project_with_the_policy_fail_is_not_rendered_from_a_damaged_source(
    farm: Farm, cut: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], home: Path
) -> None:
    layer = {"id": "l1", "method": "abstraction", "params": {"lines": "off"}}
    document = {
        "schema": 2, "name": "Swan", "assets": {"clip": {"id": farm.assets.add(cut, "cut.mkv").id}},
        "shots": [{"id": "s1", "video": "clip", "layers": [layer]}], "output": {"on_damage": "fail"},
    }  # fmt: skip
    project = farm.projects.create(document, "").id
    with pytest.raises(DamagedMedia, match="frames 11-23 of 24 are missing"):
        farm.projects.submit(project)
    farm.projects.export(project, tmp_path / "project.zip")
    words = ["render", str(tmp_path / "project.zip"), "-o", str(tmp_path / "out.mp4"), "--home", str(home), "--json"]
    assert run([*words, "--quiet"]) == 2
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["error"]["code"] == "damaged-media"


def _final(client: TestClient, farm: Farm, job_id: str) -> dict[str, Any]:
    last_seq = 0
    while not farm.jobs.get(job_id).state.final:
        assert farm.jobs.wait_for_event(job_id, last_seq, 60.0)
        last_seq = farm.jobs.events(job_id, last_seq)[0][-1].seq
    found: dict[str, Any] = client.get(f"/v1/jobs/{job_id}").json()
    return found


def test_a_request_without_the_field_keeps_its_idempotency_key() -> None:
    """Versions that do not know the field have stored requests without it."""
    plain = JobRequest("abstraction", {})
    assert "on_damage" not in request_to_json(plain) and request_of(request_to_json(plain)) == plain
    strict = JobRequest("abstraction", {}, on_damage="fail")
    assert request_of(request_to_json(strict)) == strict

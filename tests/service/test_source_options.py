"""Which picture, sound and order of fields of a video is read: in previews, projects and estimates as in jobs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from fastapi.testclient import TestClient

from service.app import create_app
from service.settings import Settings
from tests.pipeline.video.films import film
from tests.pipeline.video.test_real_films import two_streams
from tests.service.records import picture, records
from workers.farm import Farm, open_farm

SIZES = ((96, 64), (64, 48))


@pytest.fixture(scope="module")
def farm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Farm]:
    opened = open_farm(Settings(home=tmp_path_factory.mktemp("home"), pool="none"))
    yield opened
    opened.stop()


@pytest.fixture(scope="module")
def client(farm: Farm, tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    app = create_app(Settings(home=tmp_path_factory.mktemp("service"), pool="none"), farm)
    with TestClient(app, "http://127.0.0.1:8420") as opened:
        yield opened


@pytest.fixture(scope="module")
def video(client: TestClient, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = two_streams(tmp_path_factory.mktemp("media") / "two.mkv", SIZES)
    return str(client.post("/v1/assets", files={"file": ("two.mkv", path.read_bytes())}).json()["id"])


@pytest.mark.parametrize("number", [0, 1])
def test_a_preview_shows_the_chosen_picture(number: int, client: TestClient, video: str) -> None:
    body = {"method": "abstraction", "inputs": {"video": video}, "source": {"picture": number}}
    shown = cv2.imdecode(np.frombuffer(client.post("/v1/previews", json=body).content, np.uint8), cv2.IMREAD_COLOR)
    assert shown is not None and shown.shape[1::-1] == SIZES[number]


@pytest.mark.parametrize(
    ("source", "field"),
    [
        ({"picture": 2}, "source.picture"), ({"sound": [0]}, "source.sound"), ({"fields": "odd"}, "source.fields"),
        ({"picture": -1}, "source.picture"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("route", ["/v1/jobs", "/v1/previews"])
def test_what_the_video_has_not_is_refused_at_once(
    route: str, source: dict[str, Any], field: str, client: TestClient, video: str
) -> None:
    body = {"method": "abstraction", "inputs": {"video": video}, "source": source}
    answer = client.post(route, json=body)
    assert answer.status_code == 422 and field in answer.text


def test_a_sound_track_that_a_video_has_is_accepted(client: TestClient, tmp_path: Path) -> None:
    data = film(tmp_path / "s.mp4").read_bytes()
    asset = client.post("/v1/assets", files={"file": ("s.mp4", data)}).json()
    assert asset["info"]["sounds"] == 1
    body = {"method": "abstraction", "inputs": {"video": asset["id"]}}
    assert client.post("/v1/jobs", json=body | {"source": {"sound": [0]}}).status_code == 201
    assert client.post("/v1/jobs", json=body | {"source": {"sound": [1]}}).status_code == 422


def _project(client: TestClient, video: str, source: dict[str, Any]) -> str:
    layers = [{"id": "l1", "method": "abstraction"}, {"id": "l2", "method": "abstraction", "opacity": 0.5}]
    document = {
        "schema": 1, "name": "Two", "assets": {"clip": {"id": video}},
        "shots": [{"id": "s1", "video": "clip", "source": source, "layers": layers}],
    }  # fmt: skip
    made = client.post("/v1/projects", json={"document": document})
    return str(made.json()["links"]["self"])


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("what", ["source", "paint"])
def test_a_project_shows_and_paints_the_chosen_picture(what: str, number: int, client: TestClient, video: str) -> None:
    url = _project(client, video, {"picture": number})
    answer = client.post(f"{url}/previews/{what}", json={"shot": "s1", "frames": [0, 1], "max_side_px": 96})
    frame = next(data for header, data in records(answer.content) if header["type"] == "frame")
    assert picture(frame).shape[1::-1] == SIZES[number]
    sent = client.post(f"{url}/jobs", json={})
    job = client.get(f"/v1/jobs/{sent.json()['items'][0]['job']['id']}").json()
    assert job["request"]["source"]["picture"] == number


def test_a_project_whose_video_has_no_such_picture_says_where(client: TestClient, video: str) -> None:
    url = _project(client, video, {"picture": 5})
    answer = client.post(f"{url}/jobs", json={})
    assert answer.status_code == 422 and "source" in answer.text and "2 video streams" in answer.text

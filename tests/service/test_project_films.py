"""The film of a project of several shots over HTTP: only changed shots are painted, and all are joined in one file."""

from __future__ import annotations

import io
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import av
import httpx
import numpy as np
import pytest

from tests.pipeline.video.making import make_video
from tests.service.test_reuse import service
from workers.projects import films

Json = dict[str, Any]


@pytest.fixture(scope="module")
def http(tmp_path_factory: pytest.TempPathFactory) -> Iterator[httpx.Client]:
    with service(tmp_path_factory.mktemp("films")) as client:
        yield client


@pytest.fixture(scope="module")
def project(http: httpx.Client, tiny_clip: Path) -> str:
    """Two shots of the same clip, each with parameters of its own."""
    asset = http.post("/v1/assets", files={"file": ("tiny.mp4", tiny_clip.read_bytes())}).json()["id"]
    shots = [
        {"id": "s1", "video": "clip", "range": [0, 4], "layers": [{"id": "l1", "method": "abstraction"}]},
        {
            "id": "s2",
            "name": "The end",
            "video": "clip",
            "range": [4, 9],
            "layers": [{"id": "l2", "method": "abstraction"}],
        },
    ]
    document = {"schema": 2, "name": "Swan", "assets": {"clip": {"id": asset}}, "shots": shots}
    return str(http.post("/v1/projects", json={"document": document}).json()["links"]["self"])


def painted(http: httpx.Client, project: str) -> list[Json]:
    """Submit the changed shots and wait for them; the items of the answer."""
    answer = http.post(f"{project}/jobs", json={"changed": True})
    assert answer.status_code == 201, answer.text
    until = time.monotonic() + 120
    while not http.get(f"{project}/film").json()["ready"]:
        assert time.monotonic() < until
        time.sleep(0.1)
    return list(answer.json()["items"])


def edit(http: httpx.Client, project: str, patch: list[Json]) -> None:
    headers = {"If-Match": "*", "Content-Type": "application/json-patch+json"}
    assert http.request("PATCH", project, json=patch, headers=headers).status_code == 200


def frames_of(data: bytes) -> int:
    with av.open(io.BytesIO(data)) as film:
        return sum(1 for _ in film.decode(video=0))


def content_of(http: httpx.Client, project: str, **params: Any) -> httpx.Response:
    """The film in one file; asked for again while its shots are being joined."""
    until = time.monotonic() + 120
    while (answer := http.get(f"{project}/film/content", params=params)).status_code == 409:
        assert "are being joined" in answer.json()["detail"]
        assert time.monotonic() < until
        time.sleep(0.1)
    return answer


def test_only_changed_shots_are_painted_and_the_film_has_all_in_order(http: httpx.Client, project: str) -> None:
    before = http.get(f"{project}/film").json()
    assert [(one["shot"], one["name"], one["job"]) for one in before["shots"]] == [
        ("s1", "Shot 1", None), ("s2", "The end", None),
    ]  # fmt: skip
    refused = http.get(f"{project}/film/content")
    assert (refused.status_code, refused.json()["code"]) == (409, "conflict")
    assert "2 of 2 shots" in refused.json()["detail"]

    first = {one["shot"]: one["job"]["id"] for one in painted(http, project)}
    content = content_of(http, project, download=True)
    assert frames_of(content.content) == 9
    assert "Swan.mp4" in content.headers["content-disposition"]
    part = http.get(f"{project}/film/content", headers={"Range": "bytes=0-99"})
    assert (part.status_code, part.content) == (206, content.content[:100])

    edit(http, project, [{"op": "add", "path": "/shots/1/layers/0/seed", "value": 3}])
    second = {one["shot"]: one["job"]["id"] for one in painted(http, project)}
    assert second["s1"] == first["s1"], "it shows the same"
    assert second["s2"] != first["s2"]
    again = {one["shot"]: one["job"]["id"] for one in painted(http, project)}
    assert again == second, "nothing has changed"
    listed = http.get(f"{project}/jobs").json()["items"]
    assert len(listed) == 3

    edit(http, project, [{"op": "move", "from": "/shots/1", "path": "/shots/0"}])
    film = http.get(f"{project}/film").json()
    assert (film["ready"], [one["shot"] for one in film["shots"]]) == (True, ["s2", "s1"]), (
        "another order paints nothing"
    )
    earlier = http.get(f"{project}/film", params={"version": 1}).json()
    assert [one["job"]["id"] for one in earlier["shots"]] == [first["s1"], first["s2"]]
    version_1 = content_of(http, project, version=1)
    assert version_1.content == content.content, "a film of an earlier version is the same again"


def test_two_shots_that_show_the_same_have_one_film(http: httpx.Client, project: str) -> None:
    document = http.get(project).json()["document"]
    first = document["shots"][0]
    twins = [first, {**first, "id": "twin", "layers": [{**first["layers"][0], "seed": 11}]}]
    twins.append({**twins[1], "id": "triplet"})
    made = http.post("/v1/projects", json={"document": {**document, "shots": twins}}).json()["links"]["self"]
    jobs = {one["job"]["id"] for one in painted(http, made)}
    assert len(jobs) == 2
    assert frames_of(content_of(http, made).content) == 3 * (first["range"][1] - first["range"][0])


def test_films_of_single_pictures_are_not_joined(http: httpx.Client, project: str) -> None:
    edit(http, project, [{"op": "add", "path": "/output", "value": {"format": "png"}}])
    painted(http, project)
    refused = http.get(f"{project}/film/content")
    assert (refused.status_code, refused.json()["field"]) == (409, "output.format")
    edit(http, project, [{"op": "remove", "path": "/shots/1"}])
    assert http.get(f"{project}/film/content").headers["content-type"] == "application/zip", (
        "one shot has nothing to join"
    )


def test_shots_of_different_sizes_are_joined_outside_the_request_and_what_is_done_is_said(
    http: httpx.Client, project: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The request does not wait for the join here, so that its progress is seen."""
    monkeypatch.setattr(films, "WAIT_S", 0.0)
    document = http.get(f"{project}/versions/1").json()["document"]
    clip = make_video(tmp_path / "small.mp4", [np.full((64, 64, 3), 40 * k, np.uint8) for k in range(6)])
    small = http.post("/v1/assets", files={"file": ("small.mp4", clip.read_bytes())}).json()["id"]
    document["assets"]["small"] = {"id": small}
    document["shots"][1] |= {"video": "small", "range": None}
    document["output"] = {"format": "mp4"}
    made = http.post("/v1/projects", json={"document": document}).json()["links"]["self"]
    painted(http, made)
    film = http.get(f"{made}/film").json()
    assert (film["joined"], len(film["notes"])) == (0.0, 3)
    assert film["notes"][0] == (
        "The film has the size of its first shot, 96x64 px: The end (64x64) is scaled into it, with black borders "
        "where the shape differs."
    )
    answer = http.get(f"{made}/film/content")
    assert answer.status_code in (200, 409)
    if answer.status_code == 409:
        assert "are being joined" in answer.json()["detail"]
    answer = content_of(http, made)
    assert frames_of(answer.content) == 4 + 6
    assert http.get(f"{made}/film").json()["joined"] == 1.0
    with av.open(io.BytesIO(answer.content)) as joined:
        assert (joined.streams.video[0].width, joined.streams.video[0].height) == (96, 64)

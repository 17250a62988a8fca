"""Comments on frames: by the owner, and by people with a link if it allows comments; limits, deletion, upgrades."""

from __future__ import annotations

from typing import Any

import pytest
from fastapi.testclient import TestClient

from tests.service.driven_farm import DrivenFarm
from workers.store import comments as stored

Json = dict[str, Any]
NOTE = {"shot": "s1", "frame": 7, "text": " The disc is too red. ", "author": "Mia"}


def make_project(client: TestClient, asset: str) -> str:
    shots = [{"id": "s1", "video": "v", "layers": [{"id": "l1", "method": "toy"}]}]
    document = {"schema": 2, "name": "Film", "assets": {"v": {"id": asset}}, "shots": shots}
    return str(client.post("/v1/projects", json={"document": document}).json()["links"]["self"])


@pytest.fixture
def project(client: TestClient, asset: str) -> str:
    return make_project(client, asset)


def link(client: TestClient, project: str, comments: bool) -> str:
    return f"/v1/shared/{client.post(f'{project}/share', json={'comments': comments}).json()['token']}"


def test_people_with_a_link_that_allows_it_comment_and_the_owner_reads_and_deletes(
    client: TestClient, project: str
) -> None:
    shared = link(client, project, comments=True)
    made = client.post(f"{shared}/comments", json=NOTE)
    assert made.status_code == 201, made.text
    comment = made.json()
    assert {name: comment[name] for name in ("shot", "frame", "text", "author", "by_link")} == {
        "shot": "s1", "frame": 7, "text": "The disc is too red.", "author": "Mia", "by_link": True,
    }  # fmt: skip
    answer = client.post(f"{project}/comments", json={**NOTE, "text": "It is dawn.", "author": ""}).json()
    assert answer["by_link"] is False
    for at in (project, shared):
        assert [one["text"] for one in client.get(f"{at}/comments").json()["items"]] == [
            "The disc is too red.", "It is dawn.",
        ]  # fmt: skip
    assert client.request("DELETE", f"{shared}/comments/{comment['id']}").status_code in (404, 405)
    assert client.delete(f"{project}/comments/{comment['id']}").status_code == 204
    assert client.delete(f"{project}/comments/{comment['id']}").status_code == 404
    assert len(client.get(f"{shared}/comments").json()["items"]) == 1


def test_a_link_to_look_at_only_shows_and_takes_no_comments(client: TestClient, project: str) -> None:
    client.post(f"{project}/comments", json=NOTE)
    shared = link(client, project, comments=False)
    assert client.get(shared).status_code == 200
    assert client.get(f"{shared}/film").json()["comments"] is False
    for answer in (client.get(f"{shared}/comments"), client.post(f"{shared}/comments", json=NOTE)):
        assert (answer.status_code, answer.json()["code"]) == (403, "forbidden")
    assert link(client, project, comments=True) != shared
    client.delete(f"{project}/share")
    assert client.get(f"{shared}/comments").status_code == 410


@pytest.mark.parametrize(
    ("change", "status", "field"),
    [
        ({"text": ""}, 422, "text"),
        ({"text": " \n "}, 422, "text"),
        ({"text": "x" * 1001}, 422, "text"),
        ({"author": "x" * 61}, 422, "author"),
        ({"frame": -1}, 422, "frame"),
        ({"shot": "s9"}, 404, "shot"),
        ({"colour": "red"}, 422, "colour"),
    ],
)
def test_a_comment_outside_its_limits_is_refused(
    client: TestClient, project: str, change: Json, status: int, field: str
) -> None:
    answer = client.post(f"{link(client, project, comments=True)}/comments", json={**NOTE, **change})
    assert (answer.status_code, answer.json()["field"]) == (status, field)


def test_comments_are_limited_per_minute_for_links_and_in_number_for_all(
    client: TestClient, project: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    shared = link(client, project, comments=True)
    for _ in range(stored.MOST_A_MINUTE):
        assert client.post(f"{shared}/comments", json=NOTE).status_code == 201
    refused = client.post(f"{shared}/comments", json=NOTE)
    assert (refused.status_code, refused.json()["code"]) == (429, "quota-exceeded")
    assert refused.headers["Retry-After"]
    assert client.post(f"{project}/comments", json=NOTE).status_code == 201, "the owner writes on"
    monkeypatch.setattr(stored, "MOST_COMMENTS", stored.MOST_A_MINUTE + 1)
    refused = client.post(f"{project}/comments", json=NOTE)
    assert (refused.status_code, refused.json()["code"]) == (429, "quota-exceeded")


def test_a_comment_of_another_project_is_not_deleted_through_ones_own(
    client: TestClient, asset: str, project: str
) -> None:
    comment = client.post(f"{project}/comments", json=NOTE).json()["id"]
    other = make_project(client, asset)
    assert client.delete(f"{other}/comments/{comment}").status_code == 404
    assert len(client.get(f"{project}/comments").json()["items"]) == 1


def test_comments_go_with_their_project(client: TestClient, farm: DrivenFarm, project: str) -> None:
    client.post(f"{project}/comments", json=NOTE)
    client.delete(project)
    farm.store.projects.purge(-1.0)
    assert farm.comments.of(project.rpartition("/")[2]) == []

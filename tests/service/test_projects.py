"""Projects over HTTP: versions, preconditions, problems, undo, links, archives, owners. A real farm without workers."""

from __future__ import annotations

import io
import random
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from fastapi.testclient import TestClient

from pipeline.errors import StorageFull
from service.app import create_app
from service.settings import Settings
from workers.farm import Farm, open_farm

Json = dict[str, Any]


@pytest.fixture
def farm(home: Path) -> Iterator[Farm]:
    opened = open_farm(Settings(home=home, pool="none"))
    yield opened
    opened.stop()


@pytest.fixture
def client(home: Path, farm: Farm) -> Iterator[TestClient]:
    app = create_app(Settings(home=home, pool="none"), farm)
    with TestClient(app, "http://127.0.0.1:8420", raise_server_exceptions=False) as opened:
        yield opened


def _upload(client: TestClient, data: bytes, name: str, **more: Any) -> str:
    return str(client.post("/v1/assets", files={"file": (name, data)}, **more).json()["id"])


@pytest.fixture
def clip(client: TestClient, tiny_clip: Path) -> str:
    return _upload(client, tiny_clip.read_bytes(), "tiny.mp4")


def _png(width: int = 96, height: int = 64, value: int = 200) -> bytes:
    return cv2.imencode(".png", np.full((height, width, 3), value, np.uint8))[1].tobytes()


def _document(clip: str, **layer: Any) -> Json:
    return {
        "schema": 2,
        "name": "Swan",
        "assets": {"clip": {"id": clip}},
        "shots": [{"id": "s1", "video": "clip", "layers": [{"id": "l1", "method": "multistyle", **layer}]}],
    }


def _create(client: TestClient, document: Json) -> Json:
    made = client.post("/v1/projects", json={"document": document})
    assert made.status_code == 201, made.text
    found: Json = made.json()
    return found


def _put(client: TestClient, project: Json, document: Json, version: int) -> Any:
    return client.put(project["links"]["self"], json=document, headers={"If-Match": f'"{version}"'})


def test_a_project_is_saved_version_by_version(client: TestClient, clip: str) -> None:
    project = _create(client, _document(clip))
    at = project["links"]["self"]
    first = client.get(at)
    assert (first.headers["ETag"], first.json()["document"]) == ('"1"', _document(clip))
    saved = _put(client, project, _document(clip, seed=4), 1)
    assert (saved.status_code, saved.headers["ETag"], saved.json()["version"]) == (200, '"2"', 2)
    assert client.get(at, headers={"If-None-Match": '"2"'}).status_code == 304
    assert client.get(at, headers={"If-None-Match": '"1"'}).status_code == 200
    assert client.get(f"{at}/versions/1").json()["document"] == _document(clip)
    back = client.post(f"{at}/versions/1/restore", headers={"If-Match": '"2"'})
    assert (back.headers["ETag"], back.json()["document"]) == ('"3"', _document(clip))
    assert [item["version"] for item in client.get(f"{at}/versions").json()["items"]] == [3, 2, 1]
    labelled = client.put(f"{at}/versions/2/label", json={"label": "for Ann"})
    assert labelled.json()["label"] == "for Ann"


def test_a_change_requires_its_base_version(client: TestClient, clip: str) -> None:
    project = _create(client, _document(clip))
    at = project["links"]["self"]
    without = client.put(at, json=_document(clip))
    assert (without.status_code, without.json()["code"]) == (428, "precondition-required")
    assert _put(client, project, _document(clip, seed=1), 1).status_code == 200
    late = _put(client, project, _document(clip, seed=2), 1)
    assert (late.status_code, late.json()["code"], late.json()["value"]) == (412, "version-mismatch", "2")
    assert late.headers["ETag"] == '"2"'
    strange = client.put(at, json=_document(clip), headers={"If-Match": "seven"})
    assert strange.status_code == 400
    change = [{"op": "add", "path": "/name", "value": "late"}]
    headers = {"If-Match": '"1"', "Content-Type": "application/json-patch+json"}
    assert client.request("PATCH", at, json=change, headers=headers).status_code == 412


def test_a_patch_on_a_version_that_does_not_exist_is_a_mismatch(client: TestClient, clip: str) -> None:
    at = _create(client, _document(clip))["links"]["self"]
    headers = {"If-Match": '"77"', "Content-Type": "application/merge-patch+json"}
    late = client.request("PATCH", at, json={"name": "late"}, headers=headers)
    assert (late.status_code, late.json()["code"], late.headers["ETag"]) == (412, "version-mismatch", '"1"')


@pytest.mark.parametrize("kind", ["json-patch", "merge-patch", "change"])
def test_a_patch_that_grows_is_refused(client: TestClient, clip: str, kind: str) -> None:
    project = _create(client, {**_document(clip), "ui": {"a": ["x" * 1000]}})
    bomb: Any = [{"op": "copy", "from": "/ui/a", "path": "/ui/a/-"}] * 24
    if kind == "change":
        answer = client.post(f"{project['links']['self']}/previews/paint", json={"change": bomb, "shot": "s1"})
    else:
        body = bomb if kind == "json-patch" else {"ui": {"a": [0] * 300_000}}
        headers = {"If-Match": '"1"', "Content-Type": f"application/{kind}+json"}
        answer = client.request("PATCH", project["links"]["self"], json=body, headers=headers)
    assert (answer.status_code, answer.json()["code"]) in {(422, "bad-patch"), (422, "bad-json"), (400, "bad-json")}


def test_documents_have_a_quota_and_a_reserve(home: Path, farm: Farm, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = Settings(home=home, pool="none", quota_document_bytes=6000)
    client = TestClient(create_app(settings, farm), "http://127.0.0.1:8420", raise_server_exceptions=False)
    noise = [
        {"schema": 2, "name": "n", "ui": {"n": random.Random(number).randbytes(3000).hex()}} for number in range(3)
    ]
    project = client.post("/v1/projects", json={"document": noise[0]}).json()
    at = project["links"]["self"]
    for answer in (
        client.put(at, json=noise[1], headers={"If-Match": '"1"'}),
        client.patch(at, json=noise[1], headers={"If-Match": '"1"', "Content-Type": "application/merge-patch+json"}),
        client.post("/v1/projects", json={"document": noise[1]}),
    ):
        assert (answer.status_code, answer.json()["code"]) == (429, "quota-exceeded")
    assert client.delete(f"{at}?for_good=true").status_code == 204
    assert client.get(at).status_code == 404
    assert client.post("/v1/projects", json={"document": noise[1]}).status_code == 201

    def refuse(*_args: object) -> None:
        raise StorageFull("The disk is nearly full.")

    monkeypatch.setattr(type(farm.blobs), "check_free_space", refuse)
    assert client.post("/v1/projects", json={"name": "x"}).status_code == 507


def test_patches_change_a_part_of_a_project(client: TestClient, clip: str) -> None:
    at = _create(client, _document(clip))["links"]["self"]

    def patch(change: Any, kind: str, version: int) -> Any:
        headers = {"If-Match": f'"{version}"', "Content-Type": kind}
        return client.request("PATCH", at, json=change, headers=headers)

    json_patch = [{"op": "add", "path": "/shots/0/layers/0/params", "value": {"relief": 2}}]
    assert patch(json_patch, "application/json-patch+json", 1).json()["version"] == 2
    assert patch({"name": "Goose"}, "application/merge-patch+json", 2).json()["name"] == "Goose"
    found = client.get(at).json()["document"]
    assert (found["name"], found["shots"][0]["layers"][0]["params"]) == ("Goose", {"relief": 2})
    assert patch({}, "application/json", 3).status_code == 415
    empty = client.request("PATCH", at, headers={"If-Match": '"3"'})
    assert (empty.status_code, empty.json()["code"]) == (400, "bad-json")
    assert patch([{"op": "remove", "path": "/zzz"}], "application/json-patch+json", 3).json()["code"] == "bad-patch"
    wrong = patch({"shots": 3}, "application/merge-patch+json", 3)
    assert (wrong.status_code, [error["path"] for error in wrong.json()["errors"]]) == (422, ["/shots"])
    assert client.get(at).json()["version"] == 3


def test_a_project_with_problems_is_saved_but_not_rendered(client: TestClient, clip: str) -> None:
    wrong = _document(clip, params={"stroke_size": 9}, parts={"design": {"keys": [{"region": "moon", "frame": 99}]}})
    project = _create(client, wrong)
    at = project["links"]["self"]
    places = ["/shots/0/layers/0/params/stroke_size", "/shots/0/layers/0/parts/design/keys/0/region",
              "/shots/0/layers/0/parts/design/keys/0/frame"]  # fmt: skip
    assert [error["path"] for error in client.get(f"{at}/check").json()["errors"]] == places
    refused = client.post(f"{at}/jobs", json={})
    assert (refused.status_code, refused.json()["code"]) == (422, "bad-project")
    assert [error["path"] for error in refused.json()["errors"]] == places


def test_jobs_are_created_from_a_version(client: TestClient, clip: str) -> None:
    key = _upload(client, _png(), "key.png")
    document = _document(clip, method="analogy", parts={"keys": [{"frame": 12, "image": "key"}]})
    document["assets"]["key"] = {"id": key}
    project = _create(client, document)
    at = project["links"]["self"]
    made = client.post(f"{at}/jobs", json={}, headers={"Idempotency-Key": "k"})
    assert made.status_code == 201, made.text
    (item,) = made.json()["items"]
    request = item["job"]["request"]
    assert (item["shot"], item["version"], request["method"]) == ("s1", 1, "analogy")
    assert request["labels"] | {"content": ""} == {"project": project["id"], "shot": "s1", "content": ""}
    frames = client.get(f"/v1/assets/{request['inputs']['keyframes']}/content").content
    with zipfile.ZipFile(io.BytesIO(frames)) as archive:
        assert archive.namelist() == ["0000012.png"] and archive.read("0000012.png") == _png()
    again = client.post(f"{at}/jobs", json={}, headers={"Idempotency-Key": "k"}).json()["items"]
    assert again[0]["job"]["id"] == item["job"]["id"]
    assert [noted["job"]["id"] for noted in client.get(f"{at}/jobs").json()["items"]] == [item["job"]["id"]]
    assert client.get(f"{at}/versions").json()["items"][0]["jobs"] == [item["job"]["id"]]


def test_an_estimate_without_finished_jobs_is_the_methods_own(client: TestClient, clip: str) -> None:
    project = _create(client, _document(clip))
    found = client.post("/v1/estimates", json={"project": project["id"]}).json()
    (item,) = found["items"]
    assert (item["frames"], item["samples"], item["shot"], found["jobs_ahead"]) == (24, 0, "s1", 0)
    assert item["seconds"] == item["cpu_s"] > 0
    assert item["memory_bytes"] > 1e6 and item["disk_bytes"] > 0
    wrong = _create(client, _document(clip, method="oil"))
    assert client.post("/v1/estimates", json={"project": wrong["id"]}).json()["code"] == "bad-project"


def test_assets_of_a_project_cannot_be_deleted(client: TestClient, clip: str) -> None:
    _create(client, _document(clip))
    refused = client.delete(f"/v1/assets/{clip}")
    assert (refused.status_code, "'Swan'" in refused.json()["detail"]) == (409, True)


def test_a_project_deletion_can_be_undone(client: TestClient, clip: str) -> None:
    at = _create(client, _document(clip))["links"]["self"]
    assert client.delete(at).status_code == 204
    assert client.get(at).status_code == 410
    assert client.get("/v1/projects").json()["items"] == []
    assert len(client.get("/v1/projects?deleted=true").json()["items"]) == 1
    assert client.post(f"{at}/restore").status_code == 200
    assert client.get(at).json()["document"] == _document(clip)


def test_a_project_archive_is_complete(client: TestClient, clip: str, farm: Farm) -> None:
    project = _create(client, _document(clip))
    exported = client.get(project["links"]["export"])
    assert exported.headers["Content-Type"] == "application/zip"
    assert exported.content == client.get(project["links"]["export"]).content
    owned = client.post("/v1/keys", json={"name": "ben", "scopes": ["read", "submit"]}).json()["secret"]
    ben = {"Authorization": f"Bearer {owned}", "Content-Type": "application/zip"}
    imported = client.post("/v1/projects/import", content=exported.content, headers=ben)
    assert imported.status_code == 201, imported.text
    assert imported.json()["document"] == _document(clip)
    assert client.get(f"/v1/assets/{clip}", headers={"Authorization": ben["Authorization"]}).status_code == 200


@pytest.mark.parametrize("data", [b"", b"PK\x03\x04 broken", b"not a zip"])
def test_an_invalid_project_archive_is_refused(client: TestClient, data: bytes) -> None:
    refused = client.post("/v1/projects/import", content=data, headers={"Content-Type": "application/zip"})
    assert (refused.status_code, refused.json()["code"]) == (422, "unreadable-media")


def test_a_project_archive_with_a_changed_asset_is_refused(client: TestClient, clip: str) -> None:
    exported = client.get(_create(client, _document(clip))["links"]["export"]).content
    stream = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(exported)) as source, zipfile.ZipFile(stream, "w") as target:
        for name in source.namelist():
            target.writestr(name, _png() if name.startswith("assets/") else source.read(name))
    headers = {"Content-Type": "application/zip"}
    refused = client.post("/v1/projects/import", content=stream.getvalue(), headers=headers)
    assert (refused.status_code, "other bytes" in refused.json()["detail"]) == (422, True)


def _key(client: TestClient, name: str) -> tuple[str, Json]:
    made = client.post("/v1/keys", json={"name": name, "scopes": ["read", "submit"]}).json()
    return made["key"]["id"] if "key" in made else made["id"], {"Authorization": f"Bearer {made['secret']}"}


def test_projects_of_others_look_like_missing_ones(client: TestClient, tiny_clip: Path) -> None:
    (_, anna), (_, ben) = _key(client, "anna"), _key(client, "ben")
    clip = _upload(client, tiny_clip.read_bytes(), "tiny.mp4", headers=anna)
    made = client.post("/v1/projects", json={"document": _document(clip)}, headers=anna).json()
    at = made["links"]["self"]
    for route in ("", "/versions", "/versions/1", "/check", "/jobs", "/export"):
        assert client.get(at + route, headers=ben).status_code == 404, route
        assert client.get(at + route, headers=anna).status_code == 200, route
    assert client.delete(at, headers=ben).status_code == 404
    assert client.get("/v1/projects", headers=ben).json()["items"] == []


def test_a_share_link_shows_one_project_until_it_ends(client: TestClient, tiny_clip: Path) -> None:
    key_id, anna = _key(client, "anna")
    clip = _upload(client, tiny_clip.read_bytes(), "tiny.mp4", headers=anna)
    at = client.post("/v1/projects", json={"document": _document(clip)}, headers=anna).json()["links"]["self"]

    def share() -> str:
        return f"/v1/shared/{client.post(f'{at}/share', json={'days': 1}, headers=anna).json()['token']}"

    link = share()
    assert client.get(link).json()["document"] == _document(clip)
    assert client.get(f"{link}/jobs").json()["items"] == []
    assert client.get(f"{link}/assets/{clip}/content").content == tiny_clip.read_bytes()
    assert client.get(f"{link}/assets/ast_{'0' * 64}/content").status_code == 404
    assert client.get(f"{link}/jobs/job_1/result").status_code == 404
    assert client.get(f"{link[:-3]}abc").status_code == 410
    assert client.put(link, json={}).status_code == 405
    client.delete(f"{at}/share", headers=anna)
    assert client.get(link).status_code == 410
    link = share()
    assert client.get(link).status_code == 200
    client.delete(f"/v1/keys/{key_id}")
    assert client.get(link).status_code == 410


def test_a_share_link_needs_no_key(home: Path, farm: Farm, tiny_clip: Path) -> None:
    settings = Settings(home=home, pool="none", auth="required", admin_key="a" * 32)  # type: ignore[arg-type]
    app = create_app(settings, farm)
    with TestClient(app, "http://127.0.0.1:8420", raise_server_exceptions=False) as client:
        admin = {"Authorization": "Bearer " + "a" * 32}
        assert client.get("/v1/projects").status_code == 401
        project = client.post("/v1/projects", json={"name": "Swan"}, headers=admin).json()
        token = client.post(f"{project['links']['self']}/share", json={}, headers=admin).json()["token"]
        assert client.get(f"/v1/shared/{token}").json()["name"] == "Swan"
        assert client.get("/v1/shared/none.none").status_code == 410


def test_a_too_large_project_document_is_refused(client: TestClient, clip: str) -> None:
    project = _create(client, _document(clip))
    refused = _put(client, project, _document(clip, ui={"strokes": "x" * (5 << 20)}), 1)
    assert (refused.status_code, refused.json()["field"]) == (422, "document")

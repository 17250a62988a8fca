"""/v1/uploads: conformance with tus 1.0.0, and a real client across interruptions and restarts."""

from __future__ import annotations

import base64
import hashlib
import http.client
import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import pytest
from fastapi.testclient import TestClient
from tusclient.exceptions import TusCommunicationError, TusUploadFailed

from service.assets.upload_store import Upload, UploadStore
from service.settings import Settings
from tests.service.conftest import CLIP, open_client
from tests.service.driven_farm import DrivenFarm
from tests.service.live import running

if TYPE_CHECKING:
    from tusclient.client import TusClient

TUS = {"Tus-Resumable": "1.0.0"}
PIECE = TUS | {"Content-Type": "application/offset+octet-stream"}
NAME = base64.b64encode(b"clip.mp4").decode()


def begin(client: TestClient, length: int = len(CLIP), **headers: str) -> str:
    head = TUS | {"Upload-Length": str(length), "Upload-Metadata": f"filename {NAME},empty"} | headers
    answer = client.post("/v1/uploads", headers=head)
    assert answer.status_code == 201, answer.text
    return answer.headers["location"]


def patch(client: TestClient, where: str, at: int, data: bytes, **headers: str) -> Any:
    return client.patch(where, headers=PIECE | {"Upload-Offset": str(at)} | headers, content=data)


def offset(client: TestClient, where: str) -> int:
    return int(client.head(where, headers=TUS).headers["upload-offset"])


def checksum(data: bytes, algorithm: str = "sha1") -> str:
    return f"{algorithm} {base64.b64encode(hashlib.new(algorithm, data).digest()).decode()}"


def test_upload_options_list_the_extensions(client: TestClient) -> None:
    answer = client.options("/v1/uploads")
    assert answer.status_code == 204
    assert answer.headers["tus-version"] == answer.headers["tus-resumable"] == "1.0.0"
    assert "creation-with-upload" in answer.headers["tus-extension"]
    assert int(answer.headers["tus-max-size"]) > 1 << 30
    assert answer.headers["tus-checksum-algorithm"] == "sha1,sha256"


def test_upload_chunks_become_an_asset(client: TestClient, settings: Settings) -> None:
    where = begin(client)
    first = patch(client, where, 0, CLIP[:5])
    assert (first.status_code, first.headers["upload-offset"]) == (204, "5")
    assert "impasto-asset" not in first.headers
    head = client.head(where, headers=TUS)
    assert (head.headers["upload-length"], head.headers["cache-control"]) == (str(len(CLIP)), "no-store")
    assert head.headers["upload-metadata"] == f"filename {NAME},empty"
    assert head.headers["upload-expires"].endswith("GMT")
    last = patch(client, where, 5, CLIP[5:])
    asset = client.get(f"/v1/assets/{last.headers['impasto-asset']}").json()
    assert (asset["filename"], asset["size_bytes"]) == ("clip.mp4", len(CLIP))
    assert client.head(where, headers=TUS).headers["impasto-asset"] == asset["id"]
    assert not list(settings.uploads_dir.glob("*.part"))


def test_an_upload_may_be_created_with_its_first_chunk(client: TestClient) -> None:
    head = PIECE | {"Upload-Length": str(len(CLIP))}
    answer = client.post("/v1/uploads", headers=head, content=CLIP)
    assert (answer.status_code, answer.headers["upload-offset"]) == (201, str(len(CLIP)))
    assert answer.headers["impasto-asset"].startswith("ast_")


def test_a_wrong_upload_offset_is_409_with_the_right_one(client: TestClient) -> None:
    where = begin(client)
    patch(client, where, 0, CLIP[:5])
    for wrong in (0, 4, 6):
        answer = patch(client, where, wrong, b"x")
        assert (answer.status_code, answer.json()["code"]) == (409, "offset-mismatch")
        assert answer.headers["upload-offset"] == "5"
    assert offset(client, where) == 5


@pytest.mark.parametrize("verb", ["post", "head", "patch", "delete"])
def test_another_tus_version_is_412(client: TestClient, verb: str) -> None:
    where = "/v1/uploads" if verb == "post" else begin(client)
    headers = PIECE | {"Tus-Resumable": "0.2.2", "Upload-Offset": "0", "Upload-Length": "5"}
    answer = client.request(verb, where, headers=headers)
    assert (answer.status_code, answer.headers["tus-version"]) == (412, "1.0.0")


def test_another_upload_content_type_is_415(client: TestClient) -> None:
    answer = patch(client, begin(client), 0, CLIP, **{"Content-Type": "video/mp4"})
    assert (answer.status_code, answer.headers["tus-resumable"]) == (415, "1.0.0")


def test_more_bytes_than_announced_are_413(client: TestClient) -> None:
    where = begin(client)
    assert patch(client, where, 0, CLIP + b"x").status_code == 413
    assert offset(client, where) == 0


def test_an_upload_above_the_size_limit_is_413(settings: Settings, farm: DrivenFarm) -> None:
    for client in open_client(settings.model_copy(update={"max_asset_bytes": 10}), farm):
        answer = client.post("/v1/uploads", headers=TUS | {"Upload-Length": "11"})
        assert (answer.status_code, answer.json()["field"]) == (413, "Upload-Length")


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("Upload-Checksum", "sha256 caf\u00e9"),
        ("Upload-Metadata", "filename caf\u00e9"),
        ("Upload-Checksum", "sha1 \u00b2"),
    ],
)
def test_base64_headers_with_other_characters_are_refused(client: TestClient, name: str, text: str) -> None:
    headers = PIECE | {"Upload-Length": "3", "Upload-Offset": "0", name: text.encode("latin-1")}
    answer = client.post("/v1/uploads", headers=headers, content=b"abc")
    assert 400 <= answer.status_code < 500 and answer.json()["field"] == name


@pytest.mark.parametrize("algorithm", ["sha1", "sha256"])
def test_the_checksum_of_an_upload_chunk_is_verified(client: TestClient, algorithm: str) -> None:
    where = begin(client)
    wrong = patch(client, where, 0, CLIP[:5], **{"Upload-Checksum": checksum(b"other", algorithm)})
    assert (wrong.status_code, wrong.json()["code"], offset(client, where)) == (460, "checksum-mismatch", 0)
    right = patch(client, where, 0, CLIP[:5], **{"Upload-Checksum": checksum(CLIP[:5], algorithm)})
    assert (right.status_code, offset(client, where)) == (204, 5)


def test_a_refused_upload_stays_refused(client: TestClient) -> None:
    where = begin(client, 4)
    first = patch(client, where, 0, b"MZ\x90\x00")
    assert (first.status_code, first.json()["code"]) == (422, "unreadable-media")
    assert client.head(where, headers=TUS).status_code == 422


def test_an_upload_can_be_terminated(client: TestClient) -> None:
    where = begin(client)
    assert client.delete(where, headers=TUS).status_code == 204
    assert client.head(where, headers=TUS).status_code == 404


def test_expired_uploads_are_410_and_deleted(client: TestClient, settings: Settings) -> None:
    where = begin(client)
    old = time.time() - settings.upload_ttl_s - 1
    for path in settings.uploads_dir.iterdir():
        os.utime(path, (old, old))
    assert client.head(where, headers=TUS).status_code == 410
    UploadStore(settings.uploads_dir, settings.upload_ttl_s).sweep()
    assert list(settings.uploads_dir.iterdir()) == []
    assert client.head(where, headers=TUS).status_code == 404


def test_concurrent_writers_of_one_upload_are_refused(client: TestClient, settings: Settings) -> None:
    where = begin(client)
    store = UploadStore(settings.uploads_dir, settings.upload_ttl_s)
    with store.claim(store.find(where.rpartition("/")[2])):
        answer = patch(client, where, 0, CLIP)
    assert (answer.status_code, answer.headers["retry-after"]) == (423, "1")
    assert patch(client, where, 0, CLIP).status_code == 204


def test_patch_can_be_sent_as_post_with_method_override(client: TestClient) -> None:
    where = begin(client)
    headers = PIECE | {"Upload-Offset": "0", "X-HTTP-Method-Override": "PATCH"}
    assert client.post(where, headers=headers, content=CLIP).headers["upload-offset"] == str(len(CLIP))


def test_an_upload_survives_a_crash_before_its_asset_is_created(client: TestClient, settings: Settings) -> None:
    where = begin(client)
    (settings.uploads_dir / f"{where.rpartition('/')[2]}.part").write_bytes(CLIP)
    assert client.head(where, headers=TUS).headers["impasto-asset"].startswith("ast_")


def limited(settings: Settings, **more: Any) -> Settings:
    return settings.model_copy(update=more)


def leave_free(monkeypatch: pytest.MonkeyPatch, free_bytes: int) -> None:
    """Set the free bytes of the disk of uploads."""
    usage = type("Usage", (), {"free": free_bytes})
    monkeypatch.setattr("service.assets.adopt.shutil.disk_usage", lambda _path: usage)


def create(client: TestClient, length: int) -> Any:
    return client.post("/v1/uploads", headers=TUS | {"Upload-Length": str(length)})


def test_open_uploads_count_against_the_quota(settings: Settings, farm: DrivenFarm) -> None:
    for client in open_client(limited(settings, quota_asset_bytes=100), farm):
        assert create(client, 60).status_code == 201
        second = create(client, 60)
        assert (second.status_code, second.json()["code"]) == (429, "quota-exceeded")
        assert create(client, 40).status_code == 201
        sent = client.post("/v1/assets", files={"file": ("clip.mp4", CLIP)})
        assert (sent.status_code, sent.json()["code"]) == (429, "quota-exceeded")


def test_the_quota_is_checked_again_when_the_upload_is_complete(settings: Settings, farm: DrivenFarm) -> None:
    for client in open_client(settings, farm):
        where = begin(client)
    for client in open_client(limited(settings, quota_asset_bytes=len(CLIP) - 1), farm):
        last = patch(client, where, 0, CLIP)
        assert (last.status_code, last.json()["code"]) == (429, "quota-exceeded")
    for client in open_client(settings, farm):  # nothing was lost: with a larger quota the upload ends
        assert "impasto-asset" in client.head(where, headers=TUS).headers


def test_open_uploads_have_their_disk_space_reserved(
    settings: Settings, farm: DrivenFarm, monkeypatch: pytest.MonkeyPatch
) -> None:
    leave_free(monkeypatch, settings.reserve_bytes + 1000)
    for client in open_client(settings, farm):
        assert create(client, 600).status_code == 201
        second = create(client, 600)
        assert (second.status_code, second.json()["code"]) == (507, "storage-full")
        assert create(client, 400).status_code == 201


def test_an_upload_chunk_never_uses_the_disk_reserve(
    settings: Settings, farm: DrivenFarm, monkeypatch: pytest.MonkeyPatch
) -> None:
    for client in open_client(settings, farm):
        where = begin(client)
        leave_free(monkeypatch, settings.reserve_bytes + 5)
        assert patch(client, where, 0, CLIP).status_code == 507
        monkeypatch.undo()
        assert offset(client, where) == 0


def test_an_owner_has_a_bounded_number_of_open_uploads(settings: Settings, farm: DrivenFarm) -> None:
    for client in open_client(limited(settings, quota_open_uploads=2), farm):
        where = [create(client, 1).headers["location"] for _ in range(2)]
        assert create(client, 1).status_code == 429
        client.delete(where[0], headers=TUS)
        assert create(client, 1).status_code == 201


def test_expired_uploads_reserve_nothing(settings: Settings, farm: DrivenFarm) -> None:
    for client in open_client(limited(settings, quota_asset_bytes=100), farm):
        where = create(client, 100).headers["location"].rpartition("/")[2]
        old = time.time() - settings.upload_ttl_s - 10
        for path in settings.uploads_dir.glob(f"{where}.*"):
            os.utime(path, (old, old))
        assert create(client, 100).status_code == 201


def test_a_head_request_during_probing_of_the_upload_succeeds(client: TestClient, settings: Settings) -> None:
    where = begin(client)
    store = UploadStore(settings.uploads_dir, settings.upload_ttl_s)
    upload = store.find(where.rpartition("/")[2])
    store.path(upload).write_bytes(CLIP)
    with store.claim(upload):
        head = client.head(where, headers=TUS)
    assert (head.status_code, head.headers["upload-offset"]) == (200, str(len(CLIP)))
    assert "impasto-asset" not in head.headers
    assert "impasto-asset" in client.head(where, headers=TUS).headers


def test_a_head_request_between_record_and_size_is_consistent(
    client: TestClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    where = begin(client)
    ask = UploadStore.offset
    waiting = [True]

    def closed_just_before(store: UploadStore, upload: Upload) -> int:
        if waiting:
            waiting.clear()
            patch(client, where, 0, CLIP)
        return ask(store, upload)

    monkeypatch.setattr(UploadStore, "offset", closed_just_before)
    head = client.head(where, headers=TUS)
    assert head.status_code == 200
    assert head.headers["impasto-asset"].startswith("ast_")


# -- a real client over a real socket


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    path = tmp_path / "clip.mp4"
    path.write_bytes(CLIP + os.urandom(300_000))
    return path


def _tus(url: str) -> TusClient:
    """tuspy for the service at `url`. It imports aiohttp: 0.6 s, which every process of the suite would spend."""
    from tusclient.client import TusClient

    return TusClient(f"{url}/v1/uploads")


def test_tuspy_uploads_in_checksummed_chunks(settings: Settings, farm: DrivenFarm, clip: Path) -> None:
    with running(settings, farm) as url:
        uploader = _tus(url).uploader(
            str(clip), chunk_size=70_000, metadata={"filename": "clip.mp4"}, upload_checksum=True
        )
        uploader.upload()
        asset_id = uploader.request.response_headers["impasto-asset"]
    assert asset_id == "ast_" + hashlib.sha256(clip.read_bytes()).hexdigest()
    assert farm.assets.get(asset_id, "").filename == "clip.mp4"


def test_tuspy_resumes_after_a_service_restart(settings: Settings, farm: DrivenFarm, clip: Path) -> None:
    with running(settings, farm) as url:
        uploader = _tus(url).uploader(str(clip), chunk_size=70_000)
        uploader.upload(stop_at=140_000)
        path = urlsplit(uploader.url).path
    with pytest.raises(TusCommunicationError):
        uploader.upload()
    with running(settings, farm) as url:
        again = _tus(url).uploader(str(clip), url=url + path, chunk_size=70_000)
        assert again.offset == 140_000
        again.upload()
        assert farm.assets.get(again.request.response_headers["impasto-asset"], "")


def test_a_broken_connection_keeps_the_received_bytes(settings: Settings, farm: DrivenFarm, clip: Path) -> None:
    data = clip.read_bytes()
    with running(settings, farm) as url:
        uploader = _tus(url).uploader(str(clip))
        uploader.set_url(uploader.create_url())
        _send_and_hang_up(uploader.url, data, sent=100_000)
        deadline = time.monotonic() + 60
        while uploader.get_offset() < 100_000 and time.monotonic() < deadline:
            time.sleep(0.02)
        resumed = _tus(url).uploader(str(clip), url=uploader.url, retries=3, retry_delay=0)
        assert resumed.offset == 100_000
        resumed.upload()
        assert resumed.request.response_headers["impasto-asset"].endswith(hashlib.sha256(data).hexdigest())


def _send_and_hang_up(url: str, data: bytes, sent: int) -> None:
    parts = urlsplit(url)
    line = http.client.HTTPConnection(parts.netloc)
    line.putrequest("PATCH", parts.path)
    for name, value in (PIECE | {"Upload-Offset": "0", "Content-Length": str(len(data))}).items():
        line.putheader(name, value)
    line.endheaders(data[:sent])
    time.sleep(0.2)
    line.close()


def test_tuspy_learns_that_its_file_is_no_video(settings: Settings, farm: DrivenFarm, tmp_path: Path) -> None:
    fake = tmp_path / "clip.mp4"
    fake.write_bytes(b"#!/bin/sh\n")
    with running(settings, farm) as url, pytest.raises(TusUploadFailed) as failure:
        _tus(url).uploader(str(fake)).upload()
    assert failure.value.status_code == 422
    assert b"unreadable-media" in failure.value.response_content

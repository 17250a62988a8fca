"""Features of S3 beyond the contract, on a real server: signed URLs, parts, faults, settings."""

from __future__ import annotations

import io
import threading
import time
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path
from typing import Any

import botocore.auth
import httpx
import pytest

from pipeline.errors import StorageError, StorageFull
from tests.contracts.stores import PART_BYTES, s3_blobs, s3_options
from tests.real.swift import Swift
from workers.blobs.local_copies import LocalCopies
from workers.blobs.open import open_blobs
from workers.blobs.open import s3_options as options_of
from workers.blobs.s3 import S3Blobs
from workers.blobs.s3_client import client_for
from workers.settings import FarmSettings


@pytest.fixture
def blobs(s3: Swift, tmp_path: Path) -> S3Blobs:
    return s3_blobs(s3, tmp_path, prefix=f"{tmp_path.name}/")


# -- signed URLs


def _get(url: str, headers: dict[str, str] | None = None) -> httpx.Response:
    return httpx.get(url, headers=headers, timeout=60)


def _put(url: str, content: bytes) -> httpx.Response:
    return httpx.put(url, content=content, timeout=60)


def test_a_signed_url_gives_the_blob_as_a_file_of_that_name(blobs: S3Blobs) -> None:
    blobs.put("k", b"frames")
    url = blobs.direct.download_url("k", "Zoë's cat.mp4", "video/mp4")
    answer = _get(url, headers={"Range": "bytes=2-"})
    assert (answer.status_code, answer.content) == (206, b"ames")
    assert answer.headers["content-type"] == "video/mp4"
    assert "Zo%C3%AB%27s%20cat.mp4" in answer.headers["content-disposition"]


def test_a_signed_url_is_valid_for_one_blob_only(blobs: S3Blobs) -> None:
    blobs.put("k", b"attempts_of")
    blobs.put("other", b"not yours")
    url = blobs.direct.download_url("k", "k", "text/plain")
    assert _get(url).content == b"attempts_of"
    assert _get(url.replace("/k?", "/other?")).status_code == 403
    assert _put(url, content=b"changed").status_code == 403


def test_a_signed_url_expires(blobs: S3Blobs, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two URLs are signed ten minutes in the past: one is valid for an hour, one for a minute."""
    blobs.put("k", b"attempts_of")
    earlier = botocore.auth.get_current_datetime() - timedelta(minutes=10)
    monkeypatch.setattr("botocore.auth.get_current_datetime", lambda: earlier)
    valid, expired = (blobs.direct.download_url("k", "k", "text/plain", seconds=s) for s in (3600, 60))
    assert _get(valid).content == b"attempts_of"
    assert _get(expired).status_code == 403


def test_sweeping_aborts_abandoned_multipart_uploads(blobs: S3Blobs, s3: Swift) -> None:
    """Another farm's upload in the same bucket is left alone."""
    for options in (blobs.options, s3_blobs(s3, blobs.copies.folder, prefix="another-farm/").options):
        client_for(options).create_multipart_upload(Bucket=options.bucket, Key=f"{options.prefix}abandoned")
    assert blobs.sweep(older_than_s=3600) == 0, "it may be in use"
    assert blobs.sweep(older_than_s=-5) == 1
    assert blobs.sweep(older_than_s=-5) == 0


# -- faults


@pytest.fixture
def away(s3: Swift) -> Iterator[Swift]:
    """A server whose object server is stopped; it is started again at the end, unless the test has done so."""
    s3.stop("object")
    yield s3
    if not s3.runs("object"):
        s3.start("object")


def test_an_unreachable_store_is_reported_and_comes_back(
    blobs: S3Blobs, away: Swift, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("workers.blobs.s3_client._TRIES", 2)
    impatient = S3Blobs(s3_options(away, prefix="away/"), blobs.copies)
    for act in (
        lambda: impatient.put("k", b"v"),
        lambda: impatient.put("k", Path(__file__)),
        lambda: impatient.get("k"),
        lambda: impatient.put_if_absent("k", b"v"),
    ):
        with pytest.raises(StorageError) as error:
            act()
        assert error.value.remedy
    began = time.monotonic()
    with pytest.raises(StorageError):
        impatient.check()
    assert time.monotonic() - began < 12, "readyz waits for this"
    away.start("object")
    impatient.put("k", b"v")
    assert impatient.get("k") == b"v"
    impatient.check()


def test_requests_are_retried_until_the_store_is_available(
    blobs: S3Blobs, away: Swift, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("workers.blobs.s3_client._TRIES", 12)  # a machine that is busy starts it slowly
    putting = threading.Thread(target=blobs.put, args=("k", b"v"))
    putting.start()
    time.sleep(0.8)
    away.start("object")
    putting.join()
    assert blobs.get("k") == b"v"


def test_an_interrupted_read_resumes_at_its_offset(blobs: S3Blobs, monkeypatch: pytest.MonkeyPatch) -> None:
    data = bytes(range(256)) * 40
    blobs.put("k", data)
    opened: list[int] = []
    broken: list[_Breaking] = []
    really = S3Blobs._open

    def breaking(self: S3Blobs, name: str, start: int, stop: int | None, etag: str = "") -> Any:
        answer = really(self, name, start, stop, etag)
        opened.append(start)
        assert answer is not None
        if len(opened) > 2:
            return answer
        broken.append(_Breaking(answer["Body"]))
        return {**answer, "Body": broken[-1]}

    monkeypatch.setattr(S3Blobs, "_open", breaking)
    monkeypatch.setattr("workers.blobs.s3.time.sleep", lambda s: None)
    assert b"".join(blobs.read("k", 100, 10_000, chunk=900)) == data[100:10_000]
    assert opened == [100, 1900, 3700]
    assert [body.closed for body in broken] == [True, True]


def test_a_read_that_is_left_closes_its_connection(blobs: S3Blobs, monkeypatch: pytest.MonkeyPatch) -> None:
    blobs.put("k", bytes(10_000))
    body = _Breaking(io.BytesIO(bytes(10_000)))
    answer = {"Body": body, "ContentLength": 10_000, "ETag": "x"}
    monkeypatch.setattr(S3Blobs, "_open", lambda *_, **__: answer)
    pieces = blobs.read("k", chunk=900)
    assert len(next(iter(pieces))) == 900
    assert not body.closed
    pieces.close()  # type: ignore[attr-defined]
    assert body.closed


class _Breaking:
    """A body that breaks off after two reads."""

    def __init__(self, body: Any) -> None:
        self._body, self._reads = body, 0
        self.closed = False

    def read(self, size: int) -> bytes:
        self._reads += 1
        if self._reads > 2:
            raise ConnectionResetError("cut off")
        return bytes(self._body.read(size))

    def close(self) -> None:
        self.closed = True


def test_a_repeatedly_interrupted_read_is_an_error(blobs: S3Blobs, monkeypatch: pytest.MonkeyPatch) -> None:
    blobs.put("k", b"v")

    def never(self: S3Blobs, *_: object, **__: object) -> Any:
        return {"Body": _Silent(), "ContentLength": 1, "ETag": "x"}

    monkeypatch.setattr(S3Blobs, "_open", never)
    monkeypatch.setattr("workers.blobs.s3.time.sleep", lambda s: None)
    with pytest.raises(StorageError):
        blobs.get("k")


class _Silent:
    def read(self, size: int) -> bytes:
        return b""

    def close(self) -> None: ...


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"secret_key": "wrong"}, "IMPASTO_S3_SECRET_KEY"),
        ({"access_key": "nobody"}, "IMPASTO_S3_ACCESS_KEY"),
        ({"bucket": "no-such-bucket"}, "IMPASTO_BLOB_URL"),
    ],
)
def test_the_error_names_the_wrong_s3_setting(s3: Swift, tmp_path: Path, wrong: dict[str, str], named: str) -> None:
    blobs = s3_blobs(s3, tmp_path, **wrong)
    for act in (lambda: blobs.put("k", b""), blobs.check, lambda: list(blobs.keys(""))):
        with pytest.raises(StorageError) as error:
            act()
        assert named in error.value.remedy


def test_an_unreachable_s3_endpoint_is_reported(tmp_path: Path, s3: Swift) -> None:
    blobs = s3_blobs(s3, tmp_path, endpoint_url="http://127.0.0.1:9")
    with pytest.raises(StorageError, match="does not answer"):
        blobs.check()


# -- settings


@pytest.mark.parametrize("checksums", [True, False])
def test_checksums_are_sent_unless_the_server_lacks_them(s3: Swift, tmp_path: Path, checksums: bool) -> None:
    blobs = s3_blobs(s3, tmp_path, checksums=checksums, prefix=f"{tmp_path.name}/")
    sent: list[str] = []
    client = client_for(blobs.options)
    client.meta.events.register("before-send.s3.*", lambda request, **_: sent.append(str(request.headers).lower()))
    blobs.put("small", b"x")
    blobs.put("large", bytes(PART_BYTES + 1))
    assert blobs.get("large") == bytes(PART_BYTES + 1)
    bodies = [headers for headers in sent if "content-length: 0" not in headers]
    assert any("x-amz-checksum-crc" in headers or "x-amz-trailer" in headers for headers in bodies) is checksums


def test_a_body_with_a_wrong_checksum_is_refused(blobs: S3Blobs) -> None:
    with pytest.raises(Exception, match=r"BadDigest|InvalidRequest|InvalidDigest|SHA256Mismatch"):
        client_for(blobs.options).put_object(
            Bucket=blobs.options.bucket, Key=f"{blobs.options.prefix}k", Body=b"hello", ChecksumCRC32="AAAAAA=="
        )
    assert blobs.size("k") is None


def test_farms_with_separate_prefixes_share_a_bucket(s3: Swift, tmp_path: Path) -> None:
    one, two = (s3_blobs(s3, tmp_path, prefix=f"{tmp_path.name}-{name}/") for name in ("one", "two"))
    one.put("k", b"1")
    assert two.size("k") is None
    assert list(two.keys("")) == []


def test_settings_name_a_bucket_and_a_prefix(tmp_path: Path) -> None:
    settings = FarmSettings(home=tmp_path, blob_url="s3://films/impasto/one/", s3_secret_key="hidden")  # type: ignore[arg-type]
    options = options_of(settings)
    assert (options.bucket, options.prefix, options.secret_key) == ("films", "impasto/one/", "hidden")
    assert options_of(FarmSettings(blob_url="s3://films")).prefix == ""
    blobs = open_blobs(settings)
    assert isinstance(blobs, S3Blobs)
    assert "hidden" not in repr(blobs) and "hidden" not in repr(settings)
    for wrong in ("films", "s3://", "s3://a/../b c", "https://films", "s3://UPPER"):
        with pytest.raises(ValueError, match="blob_url"):
            FarmSettings(blob_url=wrong)


# -- local copies


def test_concurrent_readers_fetch_a_copy_once(tmp_path: Path) -> None:
    copies, fetched = LocalCopies(tmp_path / "copies", 1000), []

    def fetch(place: Path) -> None:
        fetched.append(place)
        time.sleep(0.05)
        place.write_bytes(b"film")

    def use() -> None:
        with copies.file("film", 4, fetch) as place:
            assert place.read_bytes() == b"film"

    threads = [threading.Thread(target=use) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(fetched) == 1
    assert [file.name for file in copies.folder.iterdir()] == ["film"]


def test_old_copies_are_removed_but_never_one_in_use(tmp_path: Path) -> None:
    copies = LocalCopies(tmp_path, most_bytes=10)

    def write(place: Path) -> None:
        place.write_bytes(b"12345")

    with copies.file("used", 5, write) as used:
        for name in ("old", "new", "newest"):
            with copies.file(name, 5, write):
                pass
            time.sleep(0.01)
        assert used.exists()
        assert sorted(file.name for file in tmp_path.iterdir()) == ["newest", "used"]


def test_a_failed_fetch_leaves_no_file_and_is_retried(tmp_path: Path) -> None:
    copies = LocalCopies(tmp_path, 10)

    def breaks(place: Path) -> None:
        place.write_bytes(b"ha")
        raise OSError(28, "No space left on device")

    with pytest.raises(StorageFull), copies.file("k", 4, breaks):
        pass
    assert list(tmp_path.iterdir()) == []
    with copies.file("k", 4, lambda place: place.write_bytes(b"half") and None) as place:
        assert place.read_bytes() == b"half"


def test_a_copy_that_would_fill_the_disk_is_not_fetched(tmp_path: Path) -> None:
    copies = LocalCopies(tmp_path, 10, reserve_bytes=1 << 60)
    with pytest.raises(StorageFull) as error, copies.file("k", 4, lambda place: None):
        pass
    assert error.value.remedy
    with pytest.raises(StorageFull):
        copies.check_free_space()


def test_leftovers_of_crashed_fetches_are_swept(tmp_path: Path) -> None:
    copies = LocalCopies(tmp_path, 10)
    for name in ("a.1.part", "a.lock"):
        (tmp_path / name).touch()
    assert copies.sweep(3600) == 0
    assert copies.sweep(-1) == 2

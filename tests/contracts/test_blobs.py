"""The contract of every blob store. Another implementation is one more line in `STORES`."""

from __future__ import annotations

import io
import os
import pickle
import threading
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import BadInput, StorageError, StorageFull
from tests.contracts.stores import PART_BYTES, s3_blobs
from workers.blobs.base import Blobs
from workers.blobs.disk import DiskBlobs
from workers.blobs.keys import check_key


def _disk(request: pytest.FixtureRequest, folder: Path) -> Blobs:
    return DiskBlobs(folder / "blobs")


def _s3(request: pytest.FixtureRequest, folder: Path) -> Blobs:
    return s3_blobs(request.getfixturevalue("s3"), folder, prefix=f"{folder.name}/")


STORES: dict[str, Callable[[pytest.FixtureRequest, Path], Blobs]] = {"disk": _disk, "s3": _s3}


@pytest.fixture(params=STORES)
def blobs(request: pytest.FixtureRequest, tmp_path: Path) -> Blobs:
    return STORES[request.param](request, tmp_path)


def test_blobs_from_bytes_files_paths_and_writers_are_read_back(blobs: Blobs, tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"from a path")
    blobs.put("a/bytes", b"from bytes")
    blobs.put("a/stream", io.BytesIO(b"from a stream"))
    blobs.put("a/path", path)
    blobs.put("a/writer", _write_and_go_back)
    path.unlink()
    assert [blobs.get(f"a/{kind}") for kind in ("bytes", "stream", "path", "writer")] == [
        b"from bytes",
        b"from a stream",
        b"from a path",
        b"From a writer",
    ]
    assert blobs.size("a/bytes") == 10


def _write_and_go_back(file: BinaryIO) -> None:
    file.write(b"from a writer")
    file.seek(0)
    file.write(b"F")


def test_a_failed_writer_stores_no_blob(blobs: Blobs) -> None:
    def write(file: BinaryIO) -> None:
        file.write(b"half")
        raise ValueError("no more")

    with pytest.raises(ValueError, match="no more"):
        blobs.put("k", write)
    assert blobs.size("k") is None


def test_ranges_of_a_blob_are_read_in_chunks(blobs: Blobs) -> None:
    blobs.put("k", bytes(range(100)))
    assert b"".join(blobs.read("k", 10, 35, chunk=7)) == bytes(range(10, 35))
    assert [len(piece) for piece in blobs.read("k", 10, 35, chunk=7)] == [7, 7, 7, 4]
    assert b"".join(blobs.read("k", 90)) == bytes(range(90, 100))
    assert b"".join(blobs.read("k", 50, 50)) == b""
    assert b"".join(blobs.read("k", 98, 1000)) == bytes([98, 99])


def test_a_missing_blob_raises_key_error(blobs: Blobs) -> None:
    assert blobs.size("no") is None
    for ask in (lambda: blobs.get("no"), lambda: blobs.read("no"), lambda: blobs.local("no").__enter__()):
        with pytest.raises(KeyError):
            ask()
    blobs.delete("no")


def test_put_if_absent_keeps_the_first_blob(blobs: Blobs) -> None:
    assert blobs.put_if_absent("once", b"first")
    assert not blobs.put_if_absent("once", b"second")
    assert blobs.get("once") == b"first"


def test_concurrent_put_if_absent_has_one_winner(blobs: Blobs) -> None:
    """Swift asks and writes in two steps, so that two may win there; what is stored is one of them, whole."""
    won: list[bytes] = []
    start = threading.Barrier(8)

    def race(data: bytes) -> None:
        start.wait()
        if blobs.put_if_absent("race", data):
            won.append(data)

    threads = [threading.Thread(target=race, args=(bytes([i]),)) for i in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert blobs.get("race") in won
    assert len(won) == 1 or not isinstance(blobs, DiskBlobs)


def test_blob_keys_are_listed_by_prefix_in_order(blobs: Blobs) -> None:
    for key in ("jobs/1/b", "jobs/1/a", "jobs/10/a", "jobs/2/a", "assets/x"):
        blobs.put(key, b"")
    assert list(blobs.keys("")) == ["assets/x", "jobs/1/a", "jobs/1/b", "jobs/10/a", "jobs/2/a"]
    assert list(blobs.keys("jobs/1/")) == ["jobs/1/a", "jobs/1/b"]
    assert list(blobs.keys("jobs/1")) == ["jobs/1/a", "jobs/1/b", "jobs/10/a"]
    assert list(blobs.keys("none/")) == []


def test_a_deleted_blob_can_be_stored_again(blobs: Blobs) -> None:
    blobs.put("a/b/c", b"1")
    blobs.delete("a/b/c")
    assert blobs.size("a/b/c") is None
    assert list(blobs.keys("")) == []
    blobs.put("a/b/c", b"2")
    assert blobs.get("a/b/c") == b"2"


def test_many_blobs_are_deleted_together(blobs: Blobs) -> None:
    for key in ("a/1", "a/2", "b/1"):
        blobs.put(key, b"x")
    blobs.delete_all(blobs.keys("a/"))
    blobs.delete_all(["none/1"])
    blobs.delete_all([])
    assert list(blobs.keys("")) == ["b/1"]


def test_a_long_blob_is_read_back_completely(blobs: Blobs, tmp_path: Path) -> None:
    """Longer than a part, from a file and from a stream that cannot seek."""
    data = bytes(range(256)) * (PART_BYTES // 256 * 2 + 3)
    path = tmp_path / "long"
    path.write_bytes(data)
    blobs.put("path", path)
    blobs.put("stream", OneWay(data))
    blobs.put("bytes", data)
    for key in ("path", "stream", "bytes"):
        assert blobs.size(key) == len(data)
        assert blobs.get(key) == data
    assert b"".join(blobs.read("path", PART_BYTES - 3, PART_BYTES + 3)) == data[PART_BYTES - 3 : PART_BYTES + 3]
    with blobs.local("stream") as copy:
        assert copy.read_bytes() == data


def test_an_interrupted_put_stores_no_blob(blobs: Blobs) -> None:
    for length in (0, PART_BYTES + 1):
        with pytest.raises(StorageError):
            blobs.put("k", OneWay(bytes(length), breaks=True))
    assert blobs.size("k") is None
    assert list(blobs.keys("")) == []


class OneWay(io.RawIOBase):
    """A stream that can only be read on, and may break at its end."""

    def __init__(self, data: bytes, breaks: bool = False) -> None:
        self._data, self._breaks = io.BytesIO(data), breaks

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return False

    def read(self, size: int = -1) -> bytes:
        piece = self._data.read(size)
        if not piece and self._breaks:
            raise ConnectionError("cut off")
        return piece


def test_a_local_copy_has_the_bytes_of_the_blob(blobs: Blobs) -> None:
    blobs.put("clip.mp4", b"frames")
    with blobs.local("clip.mp4") as path:
        assert path.read_bytes() == b"frames"


@pytest.mark.parametrize(
    "key", ["../x", "a/../b", "/etc/passwd", "a//b", "", "a/", ".", "a b", "a\\b", "ä", "a\0b", "~tmp/x"]
)
def test_blob_keys_outside_the_root_are_refused(blobs: Blobs, key: str) -> None:
    with pytest.raises(BadInput):
        blobs.put(key, b"")
    with pytest.raises(BadInput):
        blobs.get(key)


@given(st.text(max_size=40))
def test_no_blob_key_leaves_the_root(key: str) -> None:
    try:
        check_key(key)
    except BadInput:
        return
    root = Path("/root/blobs")
    assert Path(os.path.normpath(root / key)).is_relative_to(root)


def test_a_blob_store_is_small_when_pickled(blobs: Blobs) -> None:
    blobs.put("k", b"v")
    assert pickle.loads(pickle.dumps(blobs)).get("k") == b"v"


def test_a_working_store_passes_its_check(blobs: Blobs) -> None:
    blobs.check()


# -- the disk alone


def test_an_interrupted_put_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(StorageError):
        DiskBlobs(tmp_path).put("k", OneWay(b"half", breaks=True))
    assert [file for file in tmp_path.rglob("*") if file.is_file()] == []


def test_a_full_disk_is_reported_and_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(handle: int) -> None:
        raise OSError(28, "No space left on device")

    blobs = DiskBlobs(tmp_path)
    monkeypatch.setattr("workers.blobs.disk.os.fsync", full)
    with pytest.raises(StorageFull) as error:
        blobs.put("k", b"v")
    assert error.value.remedy
    assert list(blobs.keys("")) == []


def test_a_disk_below_its_reserve_counts_as_full(tmp_path: Path) -> None:
    with pytest.raises(StorageFull):
        DiskBlobs(tmp_path, reserve_bytes=1 << 60).check()


def test_sweeping_removes_crash_leftovers_and_spares_files_in_use(tmp_path: Path) -> None:
    blobs = DiskBlobs(tmp_path)
    blobs.put("k", b"v")
    old, young = tmp_path / "~tmp" / "old", tmp_path / "~tmp" / "young"
    old.touch()
    young.touch()
    os.utime(old, (0, 0))
    assert blobs.sweep() == 1
    assert young.exists()
    assert blobs.get("k") == b"v"

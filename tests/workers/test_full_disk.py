"""The farm on a full disk: a small file system that the test creates."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text

from pipeline.errors import StorageFull
from tests.contracts.test_stores import _asset, _job
from tests.waiting import until
from tests.workers.conftest import finished, request_on, result
from workers.blobs.disk import DiskBlobs
from workers.farm import Farm
from workers.store import Store

SIZE = 6 << 20


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 6 MiB. Only root can make one."""
    place = tmp_path / "small"
    place.mkdir()
    made = ["mount", "-t", "tmpfs", "-o", f"size={SIZE}", "none", str(place)]
    if os.getuid() or subprocess.run(made, capture_output=True, check=False).returncode:
        pytest.skip("a small disk cannot be mounted here: that needs root and the right to mount")
    yield place
    subprocess.run(["umount", "-l", str(place)], check=True)


def _fill(disk: Path, leave: int = 0) -> Path:
    """Fill the disk except for `leave` bytes."""
    usage = os.statvfs(disk)
    filler = disk / "filler"
    filler.write_bytes(bytes(max(0, usage.f_bavail * usage.f_frsize - leave)))
    return filler


def test_a_blob_too_large_for_the_disk_leaves_no_file(small_disk: Path) -> None:
    blobs = DiskBlobs(small_disk / "blobs")
    blobs.put("there", b"v" * 1000)
    filler = _fill(small_disk, leave=64 << 10)
    with pytest.raises(StorageFull) as error:
        blobs.put("large", bytes(1 << 20))
    assert error.value.remedy
    assert list(blobs.keys("")) == ["there"]
    assert blobs.get("there") == b"v" * 1000
    filler.unlink()
    blobs.put("large", bytes(1 << 20))


def test_a_store_on_a_full_disk_keeps_its_data(small_disk: Path) -> None:
    store = Store(f"sqlite:///{small_disk / 'impasto.db'}")
    store.assets.add(_asset("a" * 64), lambda: True)
    before = _job(store)
    filler = _fill(small_disk)
    with pytest.raises(StorageFull):
        for _ in range(1000):
            _job(store)
    filler.unlink()
    assert store.jobs.get(before).state == "queued"
    _job(store)
    with store.database.read() as connection:
        assert connection.execute(text("PRAGMA integrity_check")).scalar() == "ok"
    store.close()


def test_on_a_full_disk_tasks_wait_and_new_jobs_are_refused(
    small_disk: Path, open_farm: Callable[..., Farm], data: Path, tmp_path: Path
) -> None:
    """The reserve leaves running tasks space to finish, so nothing fails."""
    changes: dict[str, Any] = {"home": tmp_path / "home", "blob_root": small_disk / "blobs"}
    farm = open_farm(**changes, reserve_bytes=2 << 20)
    job = farm.jobs.submit(request_on(farm, data, params={"tasks": 12, "sleep_s": 0.05, "chain": True}))
    until(lambda: farm.jobs.get(job.id).counts["succeeded"] >= 3)
    filler = _fill(small_disk, leave=1 << 20)
    until(lambda: "nearly full" in farm.ready()["pool"])
    with pytest.raises(StorageFull) as refused:
        farm.jobs.submit(request_on(farm, data))
    assert refused.value.remedy
    assert not farm.jobs.get(job.id).state.final
    filler.unlink()
    assert finished(farm, job.id, 60).error is None
    assert len(result(farm, job.id)) == 8 + 11 * 12

"""What is stored stays stored, undamaged and private, or the service says so."""

from __future__ import annotations

import os
import shutil
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from impasto.cli.app import run
from impasto.cli.doctor import checks
from impasto.cli.serve import _places
from pipeline.errors import StorageError
from service.settings import Settings
from tests.privacy.actors import Caller, service
from workers.blobs.disk import DiskBlobs
from workers.blobs.verified import is_intact
from workers.contract.record import asset_key
from workers.errors import DamagedBlob
from workers.farm import Farm, open_farm
from workers.settings import FarmSettings


def _emptied(folder: Path) -> None:
    shutil.rmtree(folder)
    folder.mkdir()


def _replaced(path: Path) -> None:
    shutil.copy(path, path.with_name("copy")).replace(path)


LOSSES: dict[str, Callable[[Path], None]] = {
    "home deleted": shutil.rmtree,
    "home emptied": _emptied,
    "database deleted": lambda home: (home / "impasto.db").unlink(),
    "database replaced": lambda home: _replaced(home / "impasto.db"),
    "blobs deleted": lambda home: shutil.rmtree(home / "blobs"),
    "disk of the blobs unmounted": lambda home: _emptied(home / "blobs"),
}  # fmt: skip


@pytest.mark.parametrize("loss", LOSSES)
def test_a_store_that_is_lost_while_the_service_runs_is_noticed(
    home: Path, farm: Farm, tiny_clip: Path, loss: str
) -> None:
    """Nothing is accepted that would be lost at the next start; the answer names the file and the remedy."""
    with service(home, farm, auth="auto", admin_key=None) as client:
        caller = Caller(client)
        asset = caller.upload(tiny_clip, "film.mp4")
        LOSSES[loss](home)
        assert caller("GET", "/readyz").status_code == 503
        request = {"method": "multistyle", "inputs": {"video": asset}}
        answers = [caller("POST", "/v1/jobs", request)]
        answers.append(client.post("/v1/assets", files={"file": ("b.mp4", tiny_clip.read_bytes() + b"0")}))
        if "blobs" not in loss:
            answers.append(caller("POST", "/v1/projects", {"name": "Swan"}))
        for answer in answers:
            assert (answer.status_code, answer.json()["code"]) == (503, "storage-unavailable"), answer.text
            assert str(home) in answer.json()["detail"] and "restart the service" in answer.json()["remedy"]


def _flip(path: Path) -> None:
    """Flip a bit without a trace in the time of change, as a disk does."""
    before = path.stat()
    with path.open("r+b") as file:
        file.seek(before.st_size // 2)
        byte = file.read(1)[0]
        file.seek(before.st_size // 2)
        file.write(bytes([byte ^ 1]))
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def _cut(path: Path) -> None:
    os.truncate(path, path.stat().st_size - 1)


@pytest.mark.parametrize("harm", [_flip, _cut, Path.unlink])
def test_damaged_bytes_are_found_by_the_check_and_replaced_by_an_upload(
    home: Path, farm: Farm, tiny_clip: Path, harm: Callable[[Path], None], capsys: pytest.CaptureFixture[str]
) -> None:
    with service(home, farm, auth="auto", admin_key=None) as client:
        caller = Caller(client)
        asset = caller.upload(tiny_clip, "film.mp4")
        stored = home / "blobs" / asset_key(asset)
        assert caller("GET", "/v1/ops/check/blobs").json() == {"violations": [], "cursor": None}
        harm(stored)
        (found,) = caller("GET", "/v1/ops/check/blobs").json()["violations"]
        assert (found["kind"], found["id"]) == ("damaged-asset", asset)
        assert caller.upload(tiny_clip, "film.mp4") == asset
        assert stored.read_bytes() == tiny_clip.read_bytes()
        assert caller("GET", "/v1/ops/check/blobs").json()["violations"] == []


def test_damaged_bytes_reach_neither_a_decoder_nor_a_download(home: Path, farm: Farm, tiny_clip: Path) -> None:
    """A process that has not read the file yet, as a worker or a restarted service, compares it first."""
    asset = farm.assets.add(tiny_clip, "film.mp4")
    key = asset_key(asset.id)
    _flip(home / "blobs" / key)
    copied = home / "other"
    shutil.copytree(home / "blobs", copied)  # other inodes: nothing in this process has seen these files
    other = DiskBlobs(copied)
    with pytest.raises(DamagedBlob, match="Upload the file again"), other.local(key):
        pass
    with pytest.raises(DamagedBlob):
        other.get(key)
    file = farm.assets.file(asset.id, "")
    with pytest.raises(DamagedBlob):
        list(farm.files.read(file))
    assert not is_intact(key, farm.blobs.read(key))
    assert len(b"".join(farm.files.read(file, 0, 10))) == 10, "ranges are not compared"


def test_the_check_of_blobs_reads_in_pieces(farm: Farm, tmp_path: Path, tiny_clip: Path) -> None:
    names = []
    for number in range(3):
        path = tmp_path / f"{number}.mp4"
        path.write_bytes(tiny_clip.read_bytes() + bytes([number]))
        names.append(farm.assets.add(path, path.name).id)
        farm.blobs.delete(asset_key(names[-1]))
    seen, cursor, requests = [], None, 0
    while cursor is not None or not requests:
        found, cursor = farm.assets.damage(cursor, most_bytes=1)
        seen += [one.id for one in found]
        requests += 1
    assert sorted(seen) == sorted(names) and requests >= 3


def test_the_files_of_a_home_are_private(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(["keys", "create", "anna", "--home", str(home)]) == 0
    modes = {path.name: stat.S_IMODE(path.stat().st_mode) for path in (home, *home.rglob("*"))}
    assert all(mode & 0o077 == 0 for mode in modes.values()), modes
    before = os.umask(0o022)
    try:
        seen: list[int] = []
        monkeypatch.setattr("service.server.serve", lambda *_: seen.append(os.umask(0o077)))
        assert run(["serve", "--home", str(home), "--port", "0"]) == 0
        assert seen == [0o077]
    finally:
        os.umask(before)


def test_a_home_that_others_can_read_is_reported(home: Path) -> None:
    home.mkdir(mode=0o755)
    (found,) = [check for check in checks(home) if check.name == "home"]
    assert (found.state, found.remedy) == ("warning", f"chmod 700 {home}")
    home.chmod(0o700)
    (found,) = [check for check in checks(home) if check.name == "home"]
    assert found.state == "ok"


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({}, "Impasto keeps everything in HOME."),
        ({"database_url": "postgresql://me:secret@db:5432/films?sslmode=require", "blob_url": "s3://films/impasto"},
         "Impasto keeps jobs and projects in postgresql://db:5432/films, files in s3://films/impasto, and unfinished "
         "uploads and its secret in HOME."),
    ],
)  # fmt: skip
def test_serve_names_the_places_of_its_data(home: Path, changes: dict[str, Any], text: str) -> None:
    assert _places(Settings(home=home, **changes)) == text.replace("HOME", str(home))


@pytest.mark.parametrize("wrong", ["a path that is too long", "read-only"])
def test_a_database_file_that_cannot_be_opened_is_not_a_server_that_is_down(home: Path, wrong: str) -> None:
    home.mkdir()
    place = home
    if wrong == "read-only":
        open_farm(FarmSettings(home=home, pool="none")).stop()
        (home / "impasto.db").unlink()
        (home / "impasto.db").mkdir()  # root may write read-only files: SQLite's error is the same
    else:
        for _ in range(5):
            place = place / ("x" * 200)
    with pytest.raises(StorageError) as refused:
        open_farm(FarmSettings(home=place, pool="none"))
    assert "file" in refused.value.message and "runs" not in refused.value.remedy, refused.value

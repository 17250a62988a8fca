"""Archives of projects that are encrypted, damaged or bombs: refused with a reason, and nothing of them is left."""

from __future__ import annotations

import hashlib
import io
import json
import resource
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from typer.testing import CliRunner

from impasto.cli.app import app
from tests.service.conftest import CLIP

ZIP = {"Content-Type": "application/zip"}
SHA = hashlib.sha256(CLIP).hexdigest()
ASSET = f"ast_{SHA}"


def manifest(filename: str = "clip.mp4", ui: Any = None, **assets: str) -> bytes:
    named = assets or {"clip": ASSET}
    document = {"schema": 2, "name": "Swan", "assets": {key: {"id": one} for key, one in named.items()}}
    packed = {one: {"file": f"assets/{one[4:]}", "filename": filename} for one in named.values()}
    return json.dumps({"format": 1, "document": {**document, "ui": ui or {}}, "assets": packed}).encode()


def zipped(
    text: bytes | None = None, method: int = zipfile.ZIP_DEFLATED, change: Callable[[bytes], bytes] = bytes,
    **entries: bytes,
) -> bytes:  # fmt: skip
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as archive:
        archive.writestr("project.json", manifest() if text is None else text)
        for name, data in ({f"assets/{SHA}": CLIP} | entries).items():
            archive.writestr(name, data)
    return change(stream.getvalue())


def flagged(data: bytes) -> bytes:
    """The archive with the mark of encryption on every entry."""
    data = data.replace(b"PK\x03\x04\x14\x00\x00\x00", b"PK\x03\x04\x14\x00\x01\x00")
    return data.replace(b"PK\x01\x02\x14\x03\x14\x00\x00\x00", b"PK\x01\x02\x14\x03\x14\x00\x01\x00")


def as_method(number: int) -> Callable[[bytes], bytes]:
    """A change of the compression method of every entry, in both headers."""

    def change(data: bytes) -> bytes:
        old, new = struct.pack("<H", zipfile.ZIP_DEFLATED), struct.pack("<H", number)
        data = data.replace(b"PK\x03\x04\x14\x00\x00\x00" + old, b"PK\x03\x04\x14\x00\x00\x00" + new)
        return data.replace(b"PK\x01\x02\x14\x03\x14\x00\x00\x00" + old, b"PK\x01\x02\x14\x03\x14\x00\x00\x00" + new)

    return change


def damaged(data: bytes) -> bytes:
    at = data.index(b"project.json") + len(b"project.json")
    return data[: at + 4] + bytes(byte ^ 0x5A for byte in data[at + 4 : at + 40]) + data[at + 40 :]


def bomb(method: int) -> bytes:
    """A manifest of 200 MB that its header announces as 1 MB."""
    large, size = b" " * (200 << 20), struct.pack("<L", 1 << 20)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as archive:
        archive.writestr("project.json", large)
    return stream.getvalue().replace(struct.pack("<L", len(large)), size)


def many_entries() -> bytes:
    """A directory of 400,000 entries in 19 MB."""
    entry = struct.pack("<4s4B4HL2L5H2L", b"PK\x01\x02", 20, 3, 20, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0) + b"a"
    directory = entry * 400_000
    return directory + struct.pack("<4s4H2LH", b"PK\x05\x06", 0, 0, 65535, 65535, len(directory), 0, 0)


WRONG: dict[str, Callable[[], bytes]] = {
    "encrypted": lambda: zipped(change=flagged),
    "bzip2": lambda: zipped(method=zipfile.ZIP_BZIP2),
    "LZMA": lambda: zipped(method=zipfile.ZIP_LZMA),
    "LZMA, damaged": lambda: damaged(zipped(method=zipfile.ZIP_LZMA)),
    "bzip2, damaged": lambda: damaged(zipped(method=zipfile.ZIP_BZIP2)),
    "deflate, damaged": lambda: damaged(zipped()),
    "stored, damaged": lambda: damaged(zipped(method=zipfile.ZIP_STORED)),
    "deflate64": lambda: zipped(change=as_method(9)),
    "PPMd": lambda: zipped(change=as_method(98)),
    "cut off": lambda: zipped()[:-30],
    "bomb, deflate": lambda: bomb(zipfile.ZIP_DEFLATED),
    "bomb, bzip2": lambda: bomb(zipfile.ZIP_BZIP2),
    "bomb, LZMA": lambda: bomb(zipfile.ZIP_LZMA),
    "many entries": many_entries,
    "NaN": lambda: zipped(manifest(ui={"a": float("nan")})),
    "deep": lambda: zipped(manifest(ui={"a": json.loads("[" * 180 + "]" * 180)})),
    "a path as file name": lambda: zipped(manifest("../../x")),
    "control characters in a file name": lambda: zipped(manifest("a\r\nb")),
    "text that turns around": lambda: zipped(manifest("a\u202eb.mp4")),
    "other bytes": lambda: zipped(**{f"assets/{SHA}": CLIP + b"!"}),
    "the second asset is wrong": lambda: zipped(
        manifest(a=ASSET, b=f"ast_{'f' * 64}"), **{f"assets/{'f' * 64}": b"something else"}
    ),
}


@pytest.mark.parametrize("make", WRONG.values(), ids=WRONG.keys())
def test_a_wrong_archive_is_refused_and_leaves_nothing(client: TestClient, make: Callable[[], bytes]) -> None:
    data = make()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    refused = client.post("/v1/projects/import", content=data, headers=ZIP)
    assert refused.status_code == 422, refused.text
    assert refused.json()["code"] in ("unreadable-media", "bad-parameter") and refused.json()["remedy"]
    assert client.get("/v1/assets").json()["items"] == []
    assert client.get("/v1/projects").json()["items"] == []
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100 << 10, "KiB"


def test_a_zip_that_another_program_has_deflated_is_imported(client: TestClient) -> None:
    made = client.post("/v1/projects/import", content=zipped(), headers=ZIP)
    assert made.status_code == 201, made.text


def test_a_refused_import_keeps_assets_that_the_owner_had(client: TestClient) -> None:
    client.post("/v1/assets", files={"file": ("clip.mp4", CLIP)})
    wrong = WRONG["the second asset is wrong"]()
    assert client.post("/v1/projects/import", content=wrong, headers=ZIP).status_code == 422
    assert [item["id"] for item in client.get("/v1/assets").json()["items"]] == [ASSET]


@pytest.mark.parametrize("name", ["encrypted", "LZMA, damaged", "deflate, damaged", "deflate64", "other bytes", "NaN"])
def test_the_command_refuses_a_wrong_archive_in_one_line(name: str, tmp_path: Path) -> None:
    source = tmp_path / "project.zip"
    source.write_bytes(WRONG[name]())
    done = CliRunner().invoke(app, ["render", str(source), str(tmp_path / "film.mp4")])
    assert done.exit_code == 2, done.output
    assert done.exception is None or isinstance(done.exception, SystemExit)
    assert "Traceback" not in done.output and not (tmp_path / "film.mp4").exists()

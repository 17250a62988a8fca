"""Each input of a command as one file: a folder becomes a zip, with the same bytes for the same files."""

from __future__ import annotations

import hashlib
import re
import shutil
import tempfile
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.errors import BadInput
from pipeline.video.shot_files import FRAMES

if TYPE_CHECKING:
    from impasto.client import Client

_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+:/", re.ASCII)
"""The beginning of a URL, as a path (which keeps one of two slashes)."""
EPOCH = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class InputFile:
    """An input of a render: its file, display name and content hash (SHA-256, hexadecimal)."""

    path: Path
    filename: str
    sha256: str


def gather(field: str, path: Path, scratch: Path) -> InputFile:
    """The file at `path`; a folder is zipped into `scratch` first (its files, not those of folders in it, unless it is
    a shot: see `pipeline.video.shot`).

    Raises: BadInput that names `field`: nothing there, an empty folder, neither file nor folder.
    """
    path = path.expanduser()
    if _URL.match(str(path)) and not path.exists():
        raise BadInput(
            "That is a URL, and inputs are files.", field=field, value=path, remedy="Download it, then give its path."
        )
    if not path.exists():
        raise BadInput("There is no such file or folder.", field=field, value=path, remedy="Check the path.")
    if path.is_dir():
        file = scratch / f"{len(list(scratch.iterdir())):04d}.zip"
        _zip(field, path, file)
        return InputFile(file, plain(f"{path.resolve().name}.zip"), _sha256(file))
    if not path.is_file():
        raise BadInput("It is neither a file nor a folder.", field=field, value=path, remedy="Save it to a file first.")
    try:
        return InputFile(path, plain(path.name), _sha256(path))
    except PermissionError:
        raise BadInput("It cannot be read.", field=field, value=path, remedy="Check its permissions.") from None


def upload(client: Client, paths: Mapping[str, Path], flag: str = "") -> dict[str, str]:
    """Upload each input; returns input name -> asset id. Files that the service already has are not sent again.

    Args:
        flag: prefix of an input's name in the field of an error.
    """
    with tempfile.TemporaryDirectory(prefix="impasto-") as scratch:
        files = {name: gather(f"{flag}{name}", path, Path(scratch)).path for name, path in paths.items()}
        return {name: str(client.upload(file)["id"]) for name, file in files.items()}


def plain(name: str) -> str:
    """A file's name as text that can be stored and shown; invalid bytes are replaced."""
    return name.encode("utf-8", "replace").decode()[:200]


def _zip(field: str, folder: Path, target: Path) -> None:
    """Zip the visible files of `folder` by name, uncompressed, with a fixed date and mode, so that the bytes depend on
    the files only."""
    files = _files(folder)
    if not files:
        raise BadInput("There are no files in the folder.", field=field, value=folder, remedy="Put the frames in it.")
    with zipfile.ZipFile(target, "w", zipfile.ZIP_STORED) as archive:
        for file in files:
            entry = zipfile.ZipInfo(file.relative_to(folder).as_posix(), EPOCH)
            entry.external_attr = 0o644 << 16
            with file.open("rb") as source, archive.open(entry, "w", force_zip64=True) as sink:
                shutil.copyfileobj(source, sink, 1 << 20)


def _files(folder: Path) -> list[Path]:
    """Visible files, in the order of their names; those in its folders too if it is a shot."""
    deep = (folder / FRAMES).is_dir()
    return sorted(
        p for p in (folder.rglob("*") if deep else folder.iterdir())
        if p.is_file() and not any(part.startswith(".") for part in p.relative_to(folder).parts)
    )  # fmt: skip


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()

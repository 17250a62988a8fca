"""Each input of a command as one file: a folder becomes a zip, with the same bytes for the same files."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import tempfile
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from impasto.delivery import expanded
from pipeline.errors import BadInput
from pipeline.formats import image_format_of
from pipeline.video.media import Note
from pipeline.video.numbering import is_pattern
from pipeline.video.sequence import image_files, left_out
from pipeline.video.sequence_options import OPTIONS_FILE, USUAL, SequenceOptions, embed
from pipeline.video.shot_files import FRAMES

if TYPE_CHECKING:
    from impasto_client import Client

_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+:/", re.ASCII)
"""The beginning of a URL, as a path (which keeps one of two slashes)."""
EPOCH = (1980, 1, 1, 0, 0, 0)


@dataclass(frozen=True)
class InputFile:
    """An input of a render: its file, display name and content hash (SHA-256, hexadecimal), and what was left out."""

    path: Path
    filename: str
    sha256: str
    notes: tuple[Note, ...] = ()


def gather(
    field: str, path: Path, scratch: Path, sequence: SequenceOptions = USUAL, numbered: bool = False
) -> InputFile:
    """The file at `path`. A folder is zipped into `scratch` first (its images, not those of folders in it, unless it is
    a shot: see `pipeline.video.shot_archive`), and so are the images that fit a pattern.

    Args:
        sequence: how images are read; written into the zip.
        numbered: whether a single image is named by the frame that it belongs to.

    Raises: BadInput that names `field`: nothing there, an empty folder, neither file nor folder.
    """
    path = expanded(path)
    if not path.exists() and is_pattern(path.name) and path.parent.is_dir():
        sequence = sequence.model_copy(update={"pattern": path.name})
        path = path.parent
    elif _URL.match(str(path)) and not path.exists():
        raise BadInput(
            "That is a URL, and inputs are files.", field=field, value=path, remedy="Download it, then give its path."
        )
    if not path.exists():
        raise BadInput("File or folder not found.", field=field, value=path, remedy="Check the path.")
    if path.is_dir():
        files, others = _files(field, path, sequence.pattern)
        return _zipped(path, files, scratch, sequence, left_out(others))
    from workers.projects.archive import is_project

    if is_project(path):
        raise BadInput("That is an exported project, and a video is expected.", field=field, value=path,
                       remedy="Render it with `impasto render`, or open it in the studio of a service.")  # fmt: skip
    if not path.is_file():
        raise BadInput("It is neither a file nor a folder.", field=field, value=path, remedy="Save it to a file first.")
    try:
        return _one(field, path, scratch, sequence, numbered)
    except PermissionError:
        raise BadInput("It cannot be read.", field=field, value=path, remedy="Check its permissions.") from None


def _one(field: str, path: Path, scratch: Path, sequence: SequenceOptions, numbered: bool) -> InputFile:
    """The file as it is; an image with options, or with a frame's number in its name, in a zip."""
    with path.open("rb") as stream:
        image = image_format_of(stream) is not None
    has_number = numbered and any(c.isdigit() for c in path.stem)
    if image and (sequence.given or has_number):
        return _zipped(path, [path], scratch, sequence, ())
    if sequence.given and zipfile.is_zipfile(path):
        copy = Path(shutil.copyfile(path, _next(scratch)))
        embed(copy, path.name, sequence)
        return InputFile(copy, plain(path.name), _sha256(copy))
    if sequence.given:
        raise BadInput(
            f"{', '.join(f'--{name}' for name in sequence.given)}: these options are for images.", field=field,
            value=path, remedy="Leave them out: a video has its own times.",
        )  # fmt: skip
    return InputFile(path, plain(path.name), _sha256(path))


def _zipped(
    path: Path, files: Sequence[Path], scratch: Path, sequence: SequenceOptions, notes: tuple[Note, ...]
) -> InputFile:
    """Zip files by name, uncompressed, with a fixed date and mode, so that the bytes depend on the files only."""
    target, root = _next(scratch), path if path.is_dir() else path.parent
    with zipfile.ZipFile(target, "w", zipfile.ZIP_STORED) as archive:
        for file in files:
            entry = zipfile.ZipInfo(_entry_name(file.relative_to(root).as_posix()), EPOCH)
            entry.external_attr = 0o644 << 16
            with file.open("rb") as source, archive.open(entry, "w", force_zip64=True) as sink:
                shutil.copyfileobj(source, sink, 1 << 20)
        if sequence.given and not any(file.name == OPTIONS_FILE for file in files):
            archive.writestr(zipfile.ZipInfo(OPTIONS_FILE, EPOCH), sequence.document())
    return InputFile(target, plain(f"{path.resolve().name}.zip"), _sha256(target), notes)


def _next(scratch: Path) -> Path:
    return scratch / f"{len(list(scratch.iterdir())):04d}.zip"


def _entry_name(name: str) -> str:
    """A path as text; bytes that are not UTF-8 as Latin-1."""
    raw = os.fsencode(name)
    try:
        return raw.decode()
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def upload(
    client: Client, paths: Mapping[str, Path], flag: str = "", sequence: SequenceOptions = USUAL
) -> dict[str, str]:
    """Upload each input; returns input name -> asset id. Files that the service already has are not sent again.

    Args:
        flag: prefix of an input's name in the field of an error.
    """
    with tempfile.TemporaryDirectory(prefix="impasto-") as scratch:
        files = {
            name: gather(f"{flag}{name}", path, Path(scratch), sequence if name == "video" else USUAL).path
            for name, path in paths.items()
        }
        return {name: str(client.upload(file)["id"]) for name, file in files.items()}


def plain(name: str) -> str:
    """A file's name as text that can be stored and shown; invalid bytes are replaced."""
    return name.encode("utf-8", "replace").decode()[:200]


def _files(field: str, folder: Path, pattern: str) -> tuple[list[Path], list[Path]]:
    """The files to zip in the order of their names, and those that are left out; of a shot all visible files."""
    if not (folder / FRAMES).is_dir():
        if not any(folder.iterdir()):
            raise BadInput("There are no files in the folder.", field=field, value=folder, remedy="Put frames in it.")
        images, others = image_files(folder, pattern)
        if not images:
            raise BadInput("No image fits the pattern.", field=field, value=folder / pattern, remedy="Check the names.")
        return [*images, *(p for p in [folder / OPTIONS_FILE] if p.is_file())], others
    found = sorted(
        p for p in folder.rglob("*")
        if p.is_file() and not any(part.startswith(".") for part in p.relative_to(folder).parts)
    )  # fmt: skip
    if not found:
        raise BadInput("There are no files in the folder.", field=field, value=folder, remedy="Put frames in it.")
    return found, []


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()

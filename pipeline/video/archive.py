"""Zip archives of numbered PNG, JPEG or EXR images, as sequences: checked before a byte of them is unpacked.

Nothing is ever extracted to disk, so a name cannot escape; names that try are refused all the same.
"""

from __future__ import annotations

import re
import stat
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import BinaryIO, cast

from pipeline.errors import MediaTooLarge
from pipeline.video.media import Limits, unreadable

IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".exr"})
MANIFEST = "shot.json"
"""The one file of an archive that may be something else than an image: see `pipeline.video.shot`."""
_BOMB_RATIO = 200
_BOMB_FLOOR_BYTES = 1 << 20
_DAMAGE = (zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, NotImplementedError)


def open_archive(path: Path, limits: Limits) -> tuple[zipfile.ZipFile, list[zipfile.ZipInfo]]:
    """An open archive and its images in the order of the numbers in their names. The caller closes it.

    Raises: UnreadableMedia, MediaTooLarge.
    """
    try:
        archive = zipfile.ZipFile(path)
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as error:
        unreadable("The archive cannot be opened: it is cut off or damaged.", error, "Zip the frames again.")
    try:
        return archive, _checked(archive, limits)
    except BaseException:
        archive.close()
        raise


def _checked(archive: zipfile.ZipFile, limits: Limits) -> list[zipfile.ZipInfo]:
    members = archive.infolist()
    if len(members) > limits.frames:
        _too_large("The archive has too many entries.", len(members), f"At most {limits.frames}.")
    images = [m for m in members if _is_wanted(m)]
    for member in images:
        _check_bomb(member)
    total = sum(m.file_size for m in images)
    if total > limits.size_bytes:
        _too_large("The archive unpacks to too many bytes.", total, f"At most {limits.size_bytes}.")
    if not images:
        unreadable(
            "The archive holds no images.", len(members), "Zip PNG, JPEG or EXR frames, numbered in their names."
        )
    return sorted(images, key=lambda m: natural_key(m.filename))


def _is_wanted(member: zipfile.ZipInfo) -> bool:
    """Refuse what no honest archive holds; skip folders and what desktop systems leave behind."""
    _check_name(member)
    parts = PurePosixPath(member.filename).parts
    if member.is_dir() or "__MACOSX" in parts or parts[-1].startswith(".") or parts[-1] == "Thumbs.db":
        return False
    if parts[-1] == MANIFEST:
        _check_bomb(member)
        return False
    if PurePosixPath(member.filename).suffix.lower() not in IMAGE_SUFFIXES:
        unreadable("The archive holds something else than PNG, JPEG or EXR images.", member.filename,
                   "Remove that entry.")  # fmt: skip
    return True


def _check_name(member: zipfile.ZipInfo) -> None:
    name, mode = member.filename, member.external_attr >> 16
    raw = getattr(member, "orig_filename", name)
    path = PurePosixPath(name.replace("\\", "/"))
    if not path.parts or path.is_absolute() or ".." in path.parts or "\0" in raw or re.match(r"[A-Za-z]:", name):
        unreadable("An entry of the archive points outside it.", repr(raw), "Use plain relative names.")
    if stat.S_IFMT(mode) not in (0, stat.S_IFREG, stat.S_IFDIR):
        unreadable("An entry of the archive is a link or a device.", name, "Zip the files themselves.")
    if member.flag_bits & 1:
        unreadable("The archive is encrypted.", name, "Zip the frames without a password.")


def _check_bomb(member: zipfile.ZipInfo) -> None:
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        unreadable("An entry is compressed in an unusual way.", member.filename, "Use the usual zip (deflate).")
    large = member.file_size > _BOMB_FLOOR_BYTES
    if large and member.file_size > _BOMB_RATIO * max(1, member.compress_size):
        _too_large("An entry of the archive is a decompression bomb.", member.filename, "Store real images.")


def _too_large(message: str, value: object, remedy: str) -> None:
    raise MediaTooLarge(message, field="file", value=value, remedy=remedy)


@contextmanager
def entry_stream(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> Iterator[BinaryIO]:
    """One entry as a stream. Raises UnreadableMedia, also for what goes wrong while it is read."""
    try:
        with archive.open(member) as stream:
            yield cast(BinaryIO, stream)
    except _DAMAGE as error:
        unreadable("An entry of the archive is damaged.", f"{member.filename}: {error}", "Zip the frames again.")


def read_entry(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytes:
    """The bytes of one entry, never more than its header says. Raises UnreadableMedia."""
    with entry_stream(archive, member) as stream:
        return stream.read(member.file_size)


def natural_key(name: str) -> tuple[tuple[int, int | str], ...]:
    """Sort key by which `f2` comes before `f10`."""
    pieces = re.split(r"(\d+)", name)
    return tuple((0, int(p)) if p.isdigit() else (1, p) for p in pieces if p)


def number_of(name: str) -> int | None:
    """The last number in a file name (`key_010.png` is 10), or None."""
    found = re.findall(r"\d+", PurePosixPath(name).stem)
    return int(found[-1]) if found else None

"""Zip archives of numbered images, read as sequences and checked before anything is decompressed.

Entries are never extracted to disk, so their names cannot escape a folder; names that try are rejected nevertheless.
"""

from __future__ import annotations

import os
import re
import stat
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from typing import BinaryIO, cast

from pipeline.errors import MediaTooLarge
from pipeline.formats import IMAGE_NAMES, IMAGE_SUFFIXES
from pipeline.video.media import Limits, unreadable
from pipeline.video.names import unusable
from pipeline.video.sequence_options import OPTIONS_FILE, SequenceOptions, options_of

MANIFEST = "shot.json"
"""See `pipeline.video.shot_archive`. With `sequence.json`, the only entries of an archive that may be no image."""
DESKTOP_FILES = frozenset({"thumbs.db", "desktop.ini"})
"""Files that file managers leave in folders, in lower case."""
_OPTIONS_BYTES = 1 << 16
_UTF8_FLAG = 0x800
_MAX_NAME = 512
"""Maximum path length of an entry, characters. Python rejects numbers of more than 4,300 digits in names."""
_LOCAL_HEADER_BYTES = 30
"""Length of the fixed part of an entry's local header, which precedes its data."""
_DRIVE = re.compile(r"[A-Za-z]:")
_BOMB_RATIO = 200
_BOMB_FLOOR_BYTES = 1 << 20
_DAMAGE = (zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, NotImplementedError)


def open_archive(path: Path, limits: Limits) -> tuple[zipfile.ZipFile, list[zipfile.ZipInfo]]:
    """Open an archive and list its images, ordered by their names. The caller closes the archive.

    Raises:
        UnreadableMedia: the archive is damaged, encrypted or empty, or an entry is not allowed.
        MediaTooLarge: it has too many entries or decompresses to too many bytes.
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
    for member in members:
        member.filename = _spelled(member)
    if len(members) > limits.frames:
        _too_large("The archive has too many entries.", len(members), f"At most {limits.frames}.")
    _check_overlap(members)
    images = [m for m in members if _is_wanted(m)]
    for member in images:
        _check_bomb(member)
    total = sum(m.file_size for m in images)
    if total > limits.size_bytes:
        _too_large("The archive unpacks to too many bytes.", total, f"At most {limits.size_bytes}.")
    if not images:
        unreadable(
            "The archive contains no images.", len(members), f"Zip frames, numbered in their names: {IMAGE_NAMES}."
        )
    if empty := next((m.filename for m in images if m.file_size == 0), None):
        unreadable("An image of the archive is empty.", empty, "Render or export it again, or remove it.")
    return sorted(images, key=lambda m: m.filename)


def _check_overlap(members: list[zipfile.ZipInfo]) -> None:
    """Reject entries that share bytes of the file: a small archive could decompress to any size in this way."""
    ordered = sorted(members, key=lambda m: m.header_offset)
    for member, following in pairwise(ordered):
        if member.header_offset + _LOCAL_HEADER_BYTES + member.compress_size > following.header_offset:
            unreadable("Entries of the archive overlap.", following.filename, "Zip the frames again.")


def _spelled(member: zipfile.ZipInfo) -> str:
    """The entry's name with "/" as separator (Windows PowerShell writes "\\"), as UTF-8 where its bytes are that: macOS
    does not mark such names."""
    name = member.orig_filename.partition("\0")[0]
    if not member.flag_bits & _UTF8_FLAG:
        with suppress(UnicodeError):
            name = name.encode("cp437").decode()
    return name.replace("\\", "/")


def _is_wanted(member: zipfile.ZipInfo) -> bool:
    """Whether an entry is an image. False for folders, the two documents and desktop metadata; raises for any other
    file."""
    _check_name(member)
    folders, _, name = member.filename.rpartition("/")  # strings: paths would cost half of the check
    if not name or "__MACOSX" in folders.split("/") or name.startswith(".") or name.lower() in DESKTOP_FILES:
        return False
    if name in (MANIFEST, OPTIONS_FILE):
        _check_bomb(member)
        return False
    if os.path.splitext(name)[1].lower() not in IMAGE_SUFFIXES:  # noqa: PTH122
        unreadable("The archive contains a file that is not an image.", member.filename, "Remove that entry.")
    return True


def options_in(archive: zipfile.ZipFile) -> SequenceOptions | None:
    """The options of the archive's sequence, from `sequence.json` beside the images; None: it has no such file.

    Raises: BadParameter, UnreadableMedia.
    """
    found = next((m for m in archive.infolist() if m.filename.rpartition("/")[2] == OPTIONS_FILE), None)
    if found is None:
        return None
    if found.file_size > _OPTIONS_BYTES:
        unreadable(f"{OPTIONS_FILE} is too large.", found.file_size, f"At most {_OPTIONS_BYTES} bytes.")
    return options_of(read_entry(archive, found))


def _check_name(member: zipfile.ZipInfo) -> None:
    name, mode = member.filename, member.external_attr >> 16
    if len(name) > _MAX_NAME:
        unreadable("The name of an entry of the archive is too long.", name, f"Use at most {_MAX_NAME} characters.")
    raw = getattr(member, "orig_filename", name)
    leaves = name.startswith("/") or ".." in name.split("/") or _DRIVE.match(name) is not None
    if not name.strip("./") or leaves or "\0" in raw:
        unreadable("An entry of the archive points outside it.", repr(raw), "Use plain relative names.")
    if unusable(name, ""):
        unreadable("The name of an entry of the archive has control characters.", repr(raw), "Rename it.")
    if stat.S_IFMT(mode) not in (0, stat.S_IFREG, stat.S_IFDIR):
        unreadable("An entry of the archive is a link or a device.", name, "Zip the files themselves.")
    if member.flag_bits & 1:
        unreadable("The archive is encrypted.", name, "Zip the frames without a password.")


def _check_bomb(member: zipfile.ZipInfo) -> None:
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        unreadable("An entry uses an unsupported compression method.", member.filename, "Use the usual zip (deflate).")
    large = member.file_size > _BOMB_FLOOR_BYTES
    if large and member.file_size > _BOMB_RATIO * max(1, member.compress_size):
        _too_large("An entry of the archive is a decompression bomb.", member.filename, "Store real images.")


def _too_large(message: str, value: object, remedy: str) -> None:
    raise MediaTooLarge(message, field="file", value=value, remedy=remedy)


@contextmanager
def entry_stream(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> Iterator[BinaryIO]:
    """Open one entry as a stream. Raises UnreadableMedia, also for errors while the caller reads from it."""
    try:
        with archive.open(member) as stream:
            yield cast(BinaryIO, stream)
    except _DAMAGE as error:
        unreadable("An entry of the archive is damaged.", f"{member.filename}: {error}", "Zip the frames again.")


def read_entry(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> bytes:
    """Read the bytes of one entry, at most the size stated in its header. Raises UnreadableMedia."""
    with entry_stream(archive, member) as stream:
        return stream.read(member.file_size)

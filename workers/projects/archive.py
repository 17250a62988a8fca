"""A project as one zip file: `project.json` with the document, and every asset that it names.

    project.json            {"format": 1, "document": {...}, "assets": {id: {"file": "assets/...", "filename": ...}}}
    assets/<sha256>         bytes as uploaded

The same document gives the same bytes. An imported zip is checked before any of it is unpacked: its directory, names,
methods and ratios of compression. Only entries that are stored or deflated are read, because Python decompresses all of
what a piece of bzip2 or LZMA expands to at once.
"""

from __future__ import annotations

import errno
import hashlib
import io
import json
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Annotated, BinaryIO, NoReturn

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from pipeline.errors import UnreadableMedia
from pipeline.video.writer import zip_entry
from workers.contract.record import Asset
from workers.contract.request import Json
from workers.filenames import check_filename
from workers.projects.document import MAX_DOCUMENT_BYTES
from workers.projects.upgrades import upgraded
from workers.strict_json import MAX_VALUES, BadJson, strict_json

MANIFEST = "project.json"
FORMAT = 1
_MOST_ENTRIES = 20_001
_DIRECTORY_BYTES = 4 << 20
"""Maximum size of the zip's directory: Python makes an object of each of its entries when it opens the file."""
_MOST_TIMES = 200
"""Maximum ratio of compression of an entry above 1 MiB."""
_COPY_BYTES = 1 << 20
_DAMAGE = (
    zipfile.BadZipFile,
    zlib.error,
    OSError,
    EOFError,
    ValueError,
    NotImplementedError,
    RuntimeError,
    LookupError,
)


class PackedAsset(BaseModel):
    """Location of an asset in the archive."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    file: str = Field(pattern=r"^assets/[0-9a-f]{64}$")
    filename: Annotated[str, AfterValidator(check_filename)]


class Manifest(BaseModel):
    """The file project.json."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    format: int
    document: Json
    assets: dict[str, PackedAsset]


def write_archive(
    path: Path, document: Mapping[str, object], assets: Mapping[str, Asset], read: Callable[[str], Iterator[bytes]]
) -> None:
    """Write the archive.

    Args:
        assets: id -> asset, for those that the document names and the owner has.
        read: the bytes of an asset, in pieces, by its id.
    """
    packed = {key: {"file": f"assets/{found.sha256}", "filename": found.filename} for key, found in assets.items()}
    manifest = {"format": FORMAT, "document": document, "assets": dict(sorted(packed.items()))}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED, allowZip64=True) as archive:
        archive.writestr(zip_entry(MANIFEST), json.dumps(manifest, ensure_ascii=False, indent=1).encode())
        for key in sorted(assets):
            with archive.open(zip_entry(f"assets/{assets[key].sha256}"), "w", force_zip64=True) as entry:
                for piece in read(key):
                    entry.write(piece)


@dataclass(frozen=True)
class ProjectArchive:
    """An archive that was opened and checked."""

    manifest: Manifest
    _archive: zipfile.ZipFile

    @property
    def document(self) -> Json:
        """The document, in the present schema."""
        return upgraded(self.manifest.document)

    def size_bytes(self, asset_id: str) -> int:
        """Unpacked size of an asset."""
        return self._archive.getinfo(self.manifest.assets[asset_id].file).file_size

    def extract(self, asset_id: str, path: Path) -> str:
        """Write an asset's bytes to `path`; returns its file name. Raises UnreadableMedia, also for bytes that are not
        those that `asset_id` names."""
        packed = self.manifest.assets[asset_id]
        with _damage(packed.file), self._archive.open(packed.file) as source, path.open("wb") as target:
            sha256 = _copy(source, target, self._archive.getinfo(packed.file).file_size)
        if asset_id != f"ast_{sha256}":
            _refuse(
                "An asset of the archive has other bytes than its document names.", f"{asset_id} is ast_{sha256}",
                "Export the project again.",
            )  # fmt: skip
        return packed.filename


def is_project(path: Path) -> bool:
    """Whether the file is a zip with a project in it, which may be damaged."""
    if not path.is_file() or not zipfile.is_zipfile(path):
        return False
    with _damage(path.name), _Directory(path) as file, zipfile.ZipFile(file) as archive:
        return MANIFEST in archive.NameToInfo


@contextmanager
def open_project(path: Path, limit_bytes: int) -> Iterator[ProjectArchive]:
    """The project in a zip file.

    Args:
        limit_bytes: maximum size of the unpacked archive.

    Raises:
        UnreadableMedia: the file is no such archive, is damaged, lacks an asset, or is too large when unpacked.
    """
    with ExitStack() as opened:
        with _damage(path.name):
            archive = opened.enter_context(zipfile.ZipFile(opened.enter_context(_Directory(path))))
        yield ProjectArchive(_manifest(archive, limit_bytes), archive)


class _Directory(io.FileIO):
    """A file of which at most `_DIRECTORY_BYTES` are read at once. `ZipFile` reads a zip's whole directory at once."""

    def read(self, size: int | None = -1, /) -> bytes:
        if size is not None and size > _DIRECTORY_BYTES:
            raise zipfile.BadZipFile(f"its directory has {size} bytes, of {_DIRECTORY_BYTES} at most")
        return super().read(size) or b""


@contextmanager
def _damage(entry: str) -> Iterator[None]:
    """Turn every error of `zipfile` and its decompressors into UnreadableMedia."""
    try:
        yield
    except _DAMAGE as error:
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise
        _refuse("The project archive cannot be read.", f"{entry}: {error}", "Export the project again.")


def _manifest(archive: zipfile.ZipFile, limit_bytes: int) -> Manifest:
    members = {member.filename: member for member in archive.infolist()}
    if MANIFEST not in members or len(archive.infolist()) > _MOST_ENTRIES:
        _refuse(f"The archive has no {MANIFEST}.", len(members), "Use a zip file that a project was exported to.")
    for member in members.values():
        _check(member)
    total = sum(member.file_size for member in members.values())
    if total > limit_bytes or members[MANIFEST].file_size > 2 * MAX_DOCUMENT_BYTES + (8 << 20):
        _refuse("The archive unpacks to too many bytes.", total, f"At most {limit_bytes} bytes are accepted.")
    manifest = _parsed(archive, members[MANIFEST])
    if manifest.format != FORMAT:
        _refuse("The archive has another format.", manifest.format, "Import it with the version that wrote it.")
    for packed in manifest.assets.values():
        if packed.file not in members:
            _refuse("The archive lacks an asset.", packed.file, "Export the project again.")
    return manifest


def _check(member: zipfile.ZipInfo) -> None:
    if member.flag_bits & 0x1:
        _refuse("The archive is encrypted.", member.filename, "Zip the project without a password.")
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        _refuse("An entry has another compression method than deflate.", member.filename, "Use the usual zip.")
    if member.file_size > max(1 << 20, _MOST_TIMES * member.compress_size):
        _refuse("An entry of the archive is a decompression bomb.", member.filename, "Export the project again.")


def _parsed(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> Manifest:
    try:
        with _damage(MANIFEST), archive.open(member) as entry:
            text = entry.read(member.file_size)
        return Manifest.model_validate(strict_json(text, 2 * MAX_VALUES))
    except BadJson as error:
        _refuse(f"{MANIFEST} is wrong: {error.message} {error.remedy}", error.value, "Export the project again.")
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        _refuse(f"{MANIFEST} is wrong: {first['msg']}.", place, "Export the project again.")


def _copy(source: IO[bytes], target: BinaryIO, size_bytes: int) -> str:
    """Copy the number of bytes that the entry's header announces; a damaged entry may contain more. Returns the
    SHA-256."""
    left, found = size_bytes, hashlib.sha256()
    while left > 0 and (piece := source.read(min(_COPY_BYTES, left))):
        target.write(piece)
        found.update(piece)
        left -= len(piece)
    return found.hexdigest()


def _refuse(message: str, value: object, remedy: str) -> NoReturn:
    raise UnreadableMedia(message, field="archive", value=value, remedy=remedy)

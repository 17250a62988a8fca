"""A project as one zip file: `project.json` with the document, and every asset that it names.

    project.json            {"format": 1, "document": {...}, "assets": {id: {"file": "assets/...", "filename": ...}}}
    assets/<sha256>         bytes as uploaded

The same document gives the same bytes. An imported zip is checked before any of it is unpacked.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, BinaryIO, NoReturn

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from pipeline.errors import UnreadableMedia
from pipeline.video.writer import zip_entry
from workers.model import Asset, Json
from workers.projects.document import MAX_DOCUMENT_BYTES

MANIFEST = "project.json"
FORMAT = 1
_MOST_ENTRIES = 20_001
_COPY_BYTES = 1 << 20
_DAMAGE = (zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, NotImplementedError)


class PackedAsset(BaseModel):
    """Location of an asset in the archive."""

    model_config = ConfigDict(extra="ignore", frozen=True)

    file: str = Field(pattern=r"^assets/[0-9a-f]{64}$")
    filename: str = Field(max_length=255)


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
        return self.manifest.document

    def extract(self, asset_id: str, path: Path) -> str:
        """Write an asset's bytes to `path`; returns its file name. Raises UnreadableMedia."""
        packed = self.manifest.assets[asset_id]
        try:
            with self._archive.open(packed.file) as source, path.open("wb") as target:
                _copy(source, target, self._archive.getinfo(packed.file).file_size)
        except _DAMAGE as error:
            _refuse("An entry of the archive is damaged.", f"{packed.file}: {error}", "Export the project again.")
        return packed.filename


@contextmanager
def open_project(path: Path, limit_bytes: int) -> Iterator[ProjectArchive]:
    """The project in a zip file.

    Args:
        limit_bytes: maximum size of the unpacked archive.

    Raises:
        UnreadableMedia: the file is no such archive, is damaged, lacks an asset, or is too large when unpacked.
    """
    try:
        archive = zipfile.ZipFile(path)
    except _DAMAGE as error:
        _refuse("This is not a project archive.", error, "Use a zip file that a project was exported to.")
    with archive:
        yield ProjectArchive(_manifest(archive, limit_bytes), archive)


def _manifest(archive: zipfile.ZipFile, limit_bytes: int) -> Manifest:
    members = {member.filename: member for member in archive.infolist()}
    if MANIFEST not in members or len(members) > _MOST_ENTRIES:
        _refuse(f"The archive has no {MANIFEST}.", len(members), "Use a zip file that a project was exported to.")
    total = sum(member.file_size for member in members.values())
    if total > limit_bytes or members[MANIFEST].file_size > 2 * MAX_DOCUMENT_BYTES + (8 << 20):
        _refuse("The archive unpacks to too many bytes.", total, f"At most {limit_bytes} bytes are taken.")
    try:
        manifest = Manifest.model_validate_json(archive.read(MANIFEST))
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        _refuse(f"{MANIFEST} is wrong: {first['msg']}.", place, "Export the project again.")
    except _DAMAGE as error:
        _refuse("The archive is damaged.", error, "Export the project again.")
    if manifest.format != FORMAT:
        _refuse("The archive has another format.", manifest.format, "Import it with the version that wrote it.")
    for packed in manifest.assets.values():
        if packed.file not in members:
            _refuse("The archive lacks an asset.", packed.file, "Export the project again.")
    return manifest


def _copy(source: IO[bytes], target: BinaryIO, size_bytes: int) -> None:
    """Copy the number of bytes that the entry's header announces; a damaged entry may contain more."""
    left = size_bytes
    while left > 0 and (piece := source.read(min(_COPY_BYTES, left))):
        target.write(piece)
        left -= len(piece)


def _refuse(message: str, value: object, remedy: str) -> NoReturn:
    raise UnreadableMedia(message, field="archive", value=value, remedy=remedy)

"""Lazy mapping over a zip of numbered images (masks, label maps, keyframes); images are decoded on access."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from zipfile import ZipFile, ZipInfo

from pipeline.arrays import AnyArray
from pipeline.errors import UnreadableMedia
from pipeline.video.archive import number_of, open_archive, read_entry
from pipeline.video.headers import sniff
from pipeline.video.media import Limits
from pipeline.video.stills import decode_raw


class NumberedImages(Mapping[int, AnyArray]):
    """Images as stored, by the last number in their file names, ascending. A single image file has number 0.

    The caller closes it.

    Raises:
        UnreadableMedia: an entry is not an image, a name has no number, or two names have the same number.
    """

    def __init__(self, path: Path, field: str, limits: Limits | None = None) -> None:
        self._path = path
        self._limits = limits or Limits()
        with path.open("rb") as stream:
            zipped = sniff(stream) == "application/zip"
        self._archive: ZipFile | None = None
        self._members: dict[int, ZipInfo] = {}
        if zipped:
            self._archive, members = open_archive(path, self._limits)
            self._number(members, field)

    def _number(self, members: list[ZipInfo], field: str) -> None:
        for member in members:
            number = number_of(member.filename)
            if number is None or number in self._members:
                fault = "has no number in its name" if number is None else "has the number of another image"
                self.close()
                raise UnreadableMedia(
                    f"An image of the archive {fault}.",
                    field=field,
                    value=member.filename,
                    remedy="Number the images by the frames they belong to.",
                )
            self._members[number] = member

    def __getitem__(self, number: int) -> AnyArray:
        if self._archive is None:
            if number != 0:
                raise KeyError(number)
            return decode_raw(self._path.read_bytes(), self._limits)
        member = self._members[number]
        return decode_raw(read_entry(self._archive, member), self._limits, member.filename)

    def __iter__(self) -> Iterator[int]:
        return iter(sorted(self._members) if self._archive is not None else [0])

    def __len__(self) -> int:
        return len(self._members) if self._archive is not None else 1

    def close(self) -> None:
        if self._archive is not None:
            self._archive.close()

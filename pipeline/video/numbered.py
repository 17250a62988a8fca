"""Lazy mapping over numbered images (masks, label maps, keyframes), which are decoded on access."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import TypeVar
from zipfile import ZipFile

from pipeline.arrays import AnyArray
from pipeline.errors import UnreadableMedia
from pipeline.formats.decoding import decode_raw
from pipeline.video.archive import open_archive, read_entry
from pipeline.video.headers import sniff
from pipeline.video.media import Limits
from pipeline.video.numbering import described, frame_numbers, runs_of_numbers
from pipeline.video.sequence import Loader, image_files

T = TypeVar("T")


class NumberedImages(Mapping[int, AnyArray]):
    """Images as displayed, by the numbers in their file names (`pipeline.video.numbering`), ascending: those of a zip
    or a folder. A single image file, whose name may not be its own, has number 0.

    The caller closes it.

    Raises:
        UnreadableMedia: an entry is not an image, a name has no number or an unclear one, or two names have the same
            number.
    """

    def __init__(self, path: Path, field: str, limits: Limits | None = None) -> None:
        self._limits = limits or Limits()
        self._archive: ZipFile | None = None
        self.is_single = False
        """Whether this is one image without a number."""
        self._loaders = self._opened(path, field)

    def _opened(self, path: Path, field: str) -> dict[int, Loader]:
        if path.is_dir():
            files = {file.name: file for file in image_files(path)[0]}
            return {n: (name, files[name].read_bytes) for n, name in _numbered(files, field)}
        with path.open("rb") as stream:
            self.is_single = sniff(stream) != "application/zip"
        if self.is_single:
            return {0: ("image", path.read_bytes)}
        archive, members = open_archive(path, self._limits)
        try:
            found = {m.filename: m for m in members}
            loaders: dict[int, Loader] = {
                n: (name, partial(read_entry, archive, found[name])) for n, name in _numbered(found, field)
            }
        except UnreadableMedia:
            archive.close()
            raise
        self._archive = archive
        return loaders

    def __getitem__(self, number: int) -> AnyArray:
        name, load = self._loaders[number]
        return decode_raw(load(), self._limits, name)

    def __iter__(self) -> Iterator[int]:
        return iter(self._loaders)

    def __len__(self) -> int:
        return len(self._loaders)

    def close(self) -> None:
        if self._archive is not None:
            self._archive.close()


def _numbered(names: Iterable[str], field: str) -> list[tuple[int, str]]:
    """(number, name) of each name, ascending. Raises UnreadableMedia."""
    found = frame_numbers(names, field)
    if unnumbered := next((name for name, number in found.items() if number is None), None):
        raise UnreadableMedia("An image has no number in its name.", field=field, value=unnumbered,
                              remedy="Number the images by the frames they belong to.")  # fmt: skip
    return sorted((number, name) for name, number in found.items() if number is not None)


def by_frame(images: Mapping[int, T], numbers: tuple[int, ...], field: str) -> Mapping[int, T]:
    """Images by frame index, from images by the numbers of a sequence's frames; unchanged for frames counted from 0.

    Raises: UnreadableMedia: an image's number is none of the frames'.
    """
    if not numbers or getattr(images, "is_single", False):
        return images
    frames = {number: frame for frame, number in enumerate(numbers)}
    if wrong := [number for number in images if number not in frames]:
        raise no_such_frame(wrong, described(runs_of_numbers(numbers)), field)
    return _ByFrame(images, {frames[number]: number for number in images})


class _ByFrame(Mapping[int, T]):
    def __init__(self, images: Mapping[int, T], numbers: Mapping[int, int]) -> None:
        self._images, self._numbers = images, numbers

    def __getitem__(self, frame: int) -> T:
        return self._images[self._numbers[frame]]

    def __iter__(self) -> Iterator[int]:
        return iter(sorted(self._numbers))

    def __len__(self) -> int:
        return len(self._numbers)


def no_such_frame(wrong: list[int], valid: str, field: str) -> UnreadableMedia:
    """The error for images whose numbers are none of the frames'."""
    listed = ", ".join(map(str, wrong[:5])) + (" ..." if len(wrong) > 5 else "")
    return UnreadableMedia("An image has the number of no frame.", field=field, value=listed,
                           remedy=f"Number images as the frames: {valid}.")  # fmt: skip

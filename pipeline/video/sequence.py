"""Image sequences (a folder, zip or pattern of numbered images, or one still image), as frames of a video."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from collections.abc import Sequence as List
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.formats import IMAGE_NAMES, IMAGE_SUFFIXES
from pipeline.formats.decoding import decode_shown, format_of
from pipeline.frames import same_size
from pipeline.video.archive import DESKTOP_FILES, MANIFEST, open_archive, options_in, read_entry
from pipeline.video.geometry import Geometry
from pipeline.video.index import Index
from pipeline.video.media import READING, Limits, Note, SourceOptions, check_bytes, opacity_notes, unreadable
from pipeline.video.numbering import frames_of, number_by, range_of, sequence_numbers
from pipeline.video.passes import samples, settled_choice
from pipeline.video.sequence_options import OPTIONS_FILE, USUAL, SequenceOptions
from pipeline.video.shot_files import FRAMES, is_shot, pictures_of
from pipeline.video.wide_colour import colour_notes

_IMAGE_BYTES = 1 << 30
Loader = tuple[str, Callable[[], bytes]]
"""Name of an image, and a function that returns its encoded bytes."""


class Sequence:
    """Images as the frames of a video of constant rate.

    Args:
        images: number (None: unknown, only if it is the only image) and loader of each image, by number.
        limits: limits of each image.
        close: releases the source of the images.
    """

    def __init__(
        self, images: List[tuple[int | None, Loader]], limits: Limits, close: Callable[[], None],
        options: SequenceOptions = USUAL, source: SourceOptions = SourceOptions(),
    ) -> None:  # fmt: skip
        self._loaders = [loader for _, loader in images]
        self._limits, self._close, self._options, self._source = limits, close, options, source
        self._choice = options.choice
        self.has_alpha = False
        self.errors: list[str] = []
        self.unreadable: list[int] = []
        self.position: int | None = 0
        numbers = [number for number, _ in images if number is not None]
        frames = frames_of(numbers, options.missing, range_of(options.pattern), limits.frames) if numbers else None
        self._shown = frames.shown if frames else (0,)
        ticks = np.arange(len(self._shown), dtype=np.int64)
        self.index = Index(ticks, ticks, len(ticks), 1 / options.rate, True, numbers=frames.numbers if frames else ())
        settled = self._settle_choice()
        first, self.has_alpha = self._shown_image(0)
        self.geometry = Geometry((first.shape[1], first.shape[0]))
        self.pixel_format = "rgb24"
        name, load = self._loaders[0]
        choice = replace(self._choice, colour=source.colour, colour_view=source.colour_view)
        form = format_of(data := load(), name)
        notes = (*(frames.notes if frames else ()), *settled, *form.notes(data, choice))
        colours = () if form.carries.planes else colour_notes(None, source)
        self.notes = (*(Note(READING, message) for message in notes), *colours, *opacity_notes(self.has_alpha, source))

    def close(self) -> None:
        self._close()

    def read(self, start: int, stop: int) -> Iterator[AnyArray]:
        """Yield the frames [start, stop). Raises BadFrame if the size of a frame differs from that of the first."""
        for at in range(start, min(stop, len(self._shown))):
            self.position = at + 1
            shown = self._shown[at]
            yield same_size(self._load(shown), self.geometry.size, self._loaders[shown][0])

    def _settle_choice(self) -> tuple[str, ...]:
        """Choose one of several pictures of the frames; notes on the choice."""
        name, load = self._loaders[self._shown[0]]
        form = format_of(data := load(), name)
        if not form.carries.planes:
            return ()
        images = (
            form.planes(again(), self._limits, other)
            for other, again in (self._loaders[self._shown[k]] for k in samples(len(self._shown)))
        )
        self._choice, notes = settled_choice(self._choice, form.channels(io.BytesIO(data)), lambda: images)
        return notes

    def _load(self, at: int) -> AnyArray:
        return self._shown_image(at)[0]

    def _shown_image(self, at: int) -> tuple[AnyArray, bool]:
        name, load = self._loaders[at]
        return decode_shown(load(), self._limits, name, self._choice, self._source)


def open_still(
    path: Path, limits: Limits, options: SequenceOptions = USUAL, source: SourceOptions = SourceOptions()
) -> Sequence:
    """Open one image as a video of one frame."""
    check_bytes(path.stat().st_size, min(limits.size_bytes, _IMAGE_BYTES))
    return Sequence([(None, ("image", path.read_bytes))], limits, lambda: None, options, source)


def open_folder(
    path: Path, limits: Limits, options: SequenceOptions = USUAL, source: SourceOptions = SourceOptions()
) -> Sequence:
    """Open the images of a folder, or those that fit a pattern in it, by the numbers in their names; for a shot, the
    images in `frames`.

    Args:
        path: a folder, or a folder and a pattern: "shot/name.####.png".
    """
    if not path.is_dir():
        options = options.model_copy(update={"pattern": path.name})
        path = path.parent
    below = [str(p.relative_to(path)) for p in (*path.glob("*"), *path.glob("*/*"))]
    found = path / FRAMES if is_shot(below) else path
    listed, others = image_files(found, options.pattern)
    files = {p.name: p for p in listed}
    for file in files.values():
        check_bytes(file.stat().st_size, min(limits.size_bytes, _IMAGE_BYTES), file.name)
    images = sequence_numbers(files, options.pattern)
    loaders = [(number, (name, files[name].read_bytes)) for number, name in images]
    sequence = Sequence(loaders, limits, lambda: None, options, source)
    sequence.notes += left_out(others)
    return sequence


def left_out(others: List[Path]) -> tuple[Note, ...]:
    """The note about files of a folder that are no images of its sequence."""
    named = ", ".join(p.name for p in others[:3]) + (f" and {len(others) - 3} more" if len(others) > 3 else "")
    return (Note(READING, f"Files that are no images are left out: {named}."),) if others else ()


def image_files(folder: Path, pattern: str = "") -> tuple[list[Path], list[Path]]:
    """Visible images in a folder, by name, and its files that are no images; with a pattern, only images that fit it.

    Raises: UnreadableMedia: there are no images.
    """
    visible = sorted(p for p in folder.iterdir() if not p.name.startswith(".") and p.is_file())
    if pattern:
        return [p for p in visible if number_by(pattern, p.name) is not None], []
    known = (MANIFEST, OPTIONS_FILE)
    others = [p for p in visible if p.suffix.lower() not in IMAGE_SUFFIXES and p.name not in known]
    images = [p for p in visible if p.suffix.lower() in IMAGE_SUFFIXES]
    if not images:
        unreadable(
            "The folder contains no images.", folder, f"Put frames in it, numbered in their names: {IMAGE_NAMES}."
        )
    return images, [p for p in others if p.name.lower() not in DESKTOP_FILES]


def open_zip(
    path: Path, limits: Limits, options: SequenceOptions = USUAL, source: SourceOptions = SourceOptions()
) -> Sequence:
    """Open the images of a zip by the numbers in their names; for a shot, the images in `frames`.

    Args:
        options: used if the archive has no `sequence.json`.
    """
    archive, members = open_archive(path, limits)
    try:
        options = options_in(archive) or options
        frames = {member.filename: member for member in members}
        images = sequence_numbers(pictures_of(frames), options.pattern)
        loaders = [(number, (name, partial(read_entry, archive, frames[name]))) for number, name in images]
        return Sequence(loaders, limits, archive.close, options, source)
    except BaseException:
        archive.close()
        raise

"""`VideoReader`: access to the frames of videos, image sequences and still images by exact frame index."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from pipeline.arrays import AnyArray
from pipeline.errors import BadParameter
from pipeline.formats import image_format_of
from pipeline.video.animated import AnimatedImage
from pipeline.video.clip import Clip
from pipeline.video.headers import sniff
from pipeline.video.index import FrameReader, Index
from pipeline.video.media import Limits, Note, SourceOptions, check_bytes, check_size, unreadable
from pipeline.video.numbering import is_pattern
from pipeline.video.sequence import Sequence, open_folder, open_still, open_zip
from pipeline.video.sequence_options import USUAL, SequenceOptions

Source = Clip | Sequence | AnimatedImage


class VideoReader(FrameReader):
    """Reads a video container, an animated image, a folder or zip of numbered images, or one still image (a video of
    one frame).

    Frames are as displayed: rotated according to the metadata, with square pixels, over white (or as `options.opacity`
    says), converted to sRGB with the stream's matrix and range. If the size changes within the stream, pictures are
    scaled to the first one's size. A read that starts where the last one stopped never seeks. Holds a few frames in
    memory. Not
    thread-safe. The caller closes it.

    Args:
        path: a file, a folder, or a pattern of numbered images: "shot/name.####.png".
        options: how a video container is read; other kinds of files have no such choices.
        sequence: how a folder, pattern or still is read; a zip has its own `sequence.json`.

    Raises: UnreadableMedia, NoVideoStream, MediaTooLarge, BadParameter (the file has no such stream, or cannot be
    read so).
    """

    def __init__(
        self, path: Path, limits: Limits | None = None, options: SourceOptions | None = None,
        sequence: SequenceOptions = USUAL,
    ) -> None:  # fmt: skip
        self._source: Source = open_source(Path(path), limits or Limits(), options, sequence)

    def close(self) -> None:
        self._source.close()

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of every frame, px."""
        return self._source.geometry.size

    @property
    def rotation_deg(self) -> int:
        return self._source.geometry.rotation_deg

    @property
    def pixel_format(self) -> str:
        """Pixel format of the stored pictures (FFmpeg's name)."""
        return self._source.pixel_format

    @property
    def has_alpha(self) -> bool:
        """Whether pictures have opacity."""
        return self._source.has_alpha

    @property
    def index(self) -> Index:
        """Presentation times of the frames."""
        return self._source.index

    @property
    def errors(self) -> list[str]:
        """Decoding errors so far; an undecodable frame is replaced by the frame before it."""
        return self._source.errors

    @property
    def unreadable(self) -> list[int]:
        """Indices of the frames read so far that were incomplete or replaced by the frame before them."""
        return self._source.unreadable

    @property
    def notes(self) -> tuple[Note, ...]:
        """Notes on what was chosen, corrected, assumed or left out when the file was opened."""
        return self._source.notes

    @property
    def position(self) -> int | None:
        """Index of the first frame that can be read without a seek; None = no decoder is open."""
        return self._source.position

    def read(self, start: int = 0, stop: int | None = None) -> Iterator[AnyArray]:
        """Yield the frames [start, stop) in order; fewer if the video ends earlier.

        Only one read may be active at a time.
        """
        if start < 0 or (stop is not None and stop < start):
            raise ValueError(f"no frames [{start}, {stop})")
        return self._source.read(start, stop if stop is not None else _FOREVER)


_FOREVER = 1 << 62


def open_source(
    path: Path, limits: Limits, options: SourceOptions | None = None, sequence: SequenceOptions = USUAL
) -> Source:
    """The source of frames at a path. Raises: as `VideoReader`."""
    options = options or SourceOptions()
    if path.is_dir() or (not path.exists() and is_pattern(path.name)):
        return open_folder(path, limits, sequence, options)
    check_bytes(path.stat().st_size, limits.size_bytes)
    with path.open("rb") as stream:
        if form := image_format_of(stream):
            header = form.header(stream)
            check_size(header.width, header.height, limits)
            if header.animated:
                if options.colour:
                    raise BadParameter(
                        "Animated images are read as sRGB.", field="source.colour", value=options.colour,
                        remedy="Leave it out, or give numbered images.",
                    )  # fmt: skip
                return AnimatedImage(path, form, limits, options)
            return open_still(path, limits, sequence, options)
        media_type = sniff(stream)
    if media_type == "application/json":
        unreadable("The file is JSON, not pictures.")
    if media_type == "application/zip":
        return open_zip(path, limits, sequence, options)
    if sequence.given:
        raise BadParameter(
            "Options of image sequences are given for a video.", field=", ".join(sequence.given), value=path.name,
            remedy="Leave them out: a video has its own times.",
        )  # fmt: skip
    return Clip(path, limits, options)

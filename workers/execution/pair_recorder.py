"""Source frames for a quality report, saved while the first step decodes the video: decoding them again would cost more
than measuring them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator

from pipeline.frames import Frame
from pipeline.methods.base import Arrays


def keep_pairs(
    frames: Iterator[Frame], pairs: Collection[int], save: Callable[[str, Arrays], None], first: int = 0
) -> Iterator[Frame]:
    """Pass on the frames of a video from number `first` on; save both frames of each pair."""
    before: Frame | None = None
    for index, frame in enumerate(frames, first):
        if before is not None and index in pairs:
            save(pair_name(index), {"before": before, "now": frame})
        before = frame.copy() if index + 1 in pairs else None
        yield frame


def pair_name(frame: int) -> str:
    """Name of the artefact with the source frames `frame` - 1 and `frame`."""
    return f"source-pair-{frame:07d}"

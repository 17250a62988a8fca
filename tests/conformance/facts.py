"""What two readers find in one file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Self

import av
import numpy as np
from numpy.typing import NDArray

SAMPLED = (0.0, 0.5, 1.0)
"""Places of the pictures whose colours are compared, as shares of the film."""
MOST_PICTURES = 300
_MOST_PIXELS = 60_000_000


def most_pictures(path: Path) -> int:
    """How many pictures of a file are read: the first 300, of large ones fewer."""
    try:
        with av.open(str(path), metadata_errors="replace") as source:
            sizes = [stream.codec_context.width * stream.codec_context.height for stream in source.streams.video]
    except (av.FFmpegError, OSError, ValueError, AttributeError):
        return MOST_PICTURES
    return min(MOST_PICTURES, max(5, _MOST_PIXELS // max(1, *sizes, 1)))


@dataclass
class Facts:
    """One reader's findings.

    Attributes:
        pictures: number of pictures, at most `most_pictures`.
        times_s: their times from the first one, seconds.
        size: (width, height) as displayed.
        colours: mean red, green and blue of three pictures, 0..255.
        onset_s: first sound that is heard, seconds from the first picture; None: none, or not compared.
        refused: why the file was not read.
        damaged: whether the file was called damaged.
        repeated: number of pictures that stand for others, which could not be decoded.
    """

    pictures: int = 0
    times_s: list[float] = field(default_factory=list)
    size: tuple[int, int] = (0, 0)
    colours: list[list[float]] = field(default_factory=list)
    onset_s: float | None = None
    refused: str = ""
    damaged: bool = False
    repeated: int = 0
    notes: list[str] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_json(cls, value: dict[str, Any]) -> Self:
        return cls(**value | {"size": tuple(value["size"])})


class Colours:
    """Mean colours of pictures, of which only the sampled ones are kept."""

    def __init__(self) -> None:
        self._means: list[list[float]] = []

    def add(self, picture: NDArray[Any]) -> None:
        """Args: picture: RGB or RGBA (put over white), uint8."""
        shown = picture.astype(np.float32)
        if shown.shape[2] == 4:
            opaque = shown[..., 3:] / 255
            shown = shown[..., :3] * opaque + 255 * (1 - opaque)
        self._means.append([float(value) for value in shown.mean((0, 1), dtype=np.float64)])

    def sampled(self) -> list[list[float]]:
        last = len(self._means) - 1
        return [self._means[round(share * last)] for share in SAMPLED] if last >= 0 else []


def onset(pieces: Sequence[tuple[float, NDArray[Any], int]]) -> float | None:
    """Time of the first sound of at least a third of the loudest, s.

    Args:
        pieces: (time, level of each sample 0..1, samples per second).
    """
    peak = max((float(level.max(initial=0)) for _time, level, _rate in pieces), default=0.0)
    if peak < 0.02:
        return None
    for time, level, rate in pieces:
        if len(loud := np.flatnonzero(level > 0.3 * peak)):
            return time + float(loud[0]) / rate
    return None

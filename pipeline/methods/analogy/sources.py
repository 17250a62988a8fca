"""What a picture to be synthesised is made from: the job's own inputs, or a layer of a shot.

A source gives, at full size: frames with their further guides, masks and lines; velocities where they are known;
painted keyframes; a style pair. Everything after it is the same for both.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.methods.analogy.keys import Key
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.synthesis.images import Bytes, stacked

WHOLE = -1
"""Number of the layer that is the whole picture."""
GUIDE_WEIGHT = 4.0


@dataclass(frozen=True)
class Guide:
    """A further guide: its name, its weight, which its channels share, and how many it has (1 or 3)."""

    name: str
    weight: float
    channels: int

    @property
    def weights(self) -> tuple[float, ...]:
        return (self.weight / self.channels,) * self.channels


@dataclass(frozen=True)
class Picture:
    """A frame to be synthesised, at full size."""

    frame: Frame
    further: Bytes | None = None
    """Further guides, uint8 (h, w, channels), in the order of the source's `guides`."""
    distance: Plane | None = None
    """To its lines, px."""
    region: Mask | None = None
    """Where there may be paint, bool (h, w); None = everywhere."""
    mask: Mask | None = None
    """Where the layer itself is, bool (h, w); None = everywhere."""


@dataclass(frozen=True)
class Pair:
    """S and S^ at full size."""

    output: Bytes
    """S^, uint8 (h, w, 3), or (h, w, 4) with opacity."""
    guide: Bytes
    """S in CIELAB, uint8 (h, w, 3)."""
    derived: bool
    """Whether S was made of S^."""
    extra: Bytes | None = None
    """Further guides, uint8 (h, w, n)."""
    usable: Bytes | None = None
    lines: Plane | None = None
    """Distance to the style's lines, px."""

    @property
    def guides(self) -> Bytes:
        return self.guide if self.extra is None else stacked([self.guide, self.extra])


class Source(Protocol):
    """See the module."""

    layer: int
    params: AnalogyParams

    @property
    def guides(self) -> tuple[Guide, ...]:
        """The further guides that are used."""
        ...

    @property
    def found(self) -> str:
        """Name of the artefact in which the scan has saved what it has found of this source."""
        ...

    def pictures(self, start: int, stop: int) -> Iterator[Picture]: ...

    def velocities(self, first: int) -> tuple[Flow, Flow] | None:
        """V+ of frame `first` and V- of the next one, px at full size; None = to be estimated."""
        ...

    def key_frames(self) -> tuple[int, ...]:
        """Numbers of the frames that are painted on."""
        ...

    def key(self, index: int) -> Key: ...

    def pair(self) -> Pair:
        """The style pair beside the keyframes, or our own where none was given."""
        ...

    def has_pair(self) -> bool: ...


def coded(ids: np.ndarray[tuple[int, ...], np.dtype[np.integer]]) -> Bytes:
    """Object numbers as colours that lie far apart, uint8 (h, w, 3): bit k is a high bit of channel k % 3."""
    low = ids.astype(np.int64) & 0xFF ^ (ids.astype(np.int64) >> 8 & 0xFF)
    out = np.zeros((*ids.shape, 3), np.uint8)
    for bit in range(8):
        out[..., bit % 3] |= ((low >> bit & 1) << (7 - bit // 3)).astype(np.uint8)
    return out

"""The inputs of synthesis, independent of where they come from: the job's inputs, or a layer of a shot.

A source delivers, at full size: frames with extra guides, masks and line distances; velocities, where they are known;
painted keyframes; a style pair.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pipeline.errors import BadInput
from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.methods.analogy.keyframes import Keyframe
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.synthesis.images import Bytes, stacked

WHOLE = -1
"""Layer number that stands for the whole picture."""
GUIDE_WEIGHT = 4.0


@dataclass(frozen=True)
class Guide:
    """An extra guide: name, total weight of its channels, number of channels (1 or 3)."""

    name: str
    weight: float
    channels: int

    @property
    def weights(self) -> tuple[float, ...]:
        return (self.weight / self.channels,) * self.channels


@dataclass(frozen=True)
class SourceFrame:
    """One frame of the video with everything that guides its synthesis, at full size."""

    frame: Frame
    further: Bytes | None = None
    """Extra guides, uint8 (h, w, channels), in the order of `Source.guides`."""
    distance: Plane | None = None
    """Distance to the nearest line, px, float32 (h, w)."""
    region: Mask | None = None
    """Mask of the pixels that may be painted, bool (h, w); None = all pixels."""
    mask: Mask | None = None
    """Silhouette of the layer, bool (h, w); None = everywhere."""


@dataclass(frozen=True)
class StylePair:
    """Style input S and style output S^ at full size."""

    output: Bytes
    """S^, uint8 (h, w, 3), or (h, w, 4) with opacity."""
    guide: Bytes
    """S in CIELAB, uint8 (h, w, 3)."""
    derived: bool
    """Whether S was derived from S^."""
    extra: Bytes | None = None
    """Extra guides, uint8 (h, w, n)."""
    usable: Bytes | None = None
    lines: Plane | None = None
    """Distance to the lines of the style, px, float32 (h, w)."""

    @property
    def guides(self) -> Bytes:
        return self.guide if self.extra is None else stacked([self.guide, self.extra])


class Source(Protocol):
    """Inputs of one picture: the whole frame (`layer` = -1) or one layer of a shot."""

    layer: int
    params: AnalogyParams

    @property
    def guides(self) -> tuple[Guide, ...]:
        """Extra guides with a weight above 0."""
        ...

    @property
    def statistics_artefact(self) -> str:
        """Name of the artefact with this source's `LayerStatistics`, saved by the step `scan`."""
        ...

    def pictures(self, start: int, stop: int) -> Iterator[SourceFrame]: ...

    def velocities(self, first: int) -> tuple[Flow, Flow] | None:
        """V+ of frame `first` and V- of the next frame, px at full size; None = estimate them by optical flow."""
        ...

    def key_frames(self) -> tuple[int, ...]:
        """Frame numbers of the keyframes."""
        ...

    def key(self, index: int) -> Keyframe: ...

    def pair(self) -> StylePair:
        """The given style pair, or the default pair."""
        ...

    def has_pair(self) -> bool: ...


def id_colours(ids: np.ndarray[tuple[int, ...], np.dtype[np.integer]]) -> Bytes:
    """Object numbers as well separated colours, uint8 (h, w, 3): bit k becomes a high bit of channel k % 3."""
    low = ids.astype(np.int64) & 0xFF ^ (ids.astype(np.int64) >> 8 & 0xFF)
    out = np.zeros((*ids.shape, 3), np.uint8)
    for bit in range(8):
        out[..., bit % 3] |= ((low >> bit & 1) << (7 - bit // 3)).astype(np.uint8)
    return out


def keyframe_numbers(source: Source, frames: int) -> list[tuple[int, bool]]:
    """(frame number, painted everywhere) of each keyframe of a source.

    Raises:
        BadInput: the frame does not exist, or the keyframe has a wrong size or no painted pixel.
    """
    found = []
    for index in source.key_frames():
        if index >= frames:
            raise BadInput(
                f"Keyframe {index} has no frame: the video has frames 0 to {frames - 1}.",
                field="inputs.keyframes", value=index,
                remedy=f"Name keyframes by frame numbers, 0 to {frames - 1}.",
            )  # fmt: skip
        found.append((index, source.key(index).full))
    return found

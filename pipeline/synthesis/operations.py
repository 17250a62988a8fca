"""Interface of the synthesis operations.

It is implemented by `opencl.OpenCLOperations`, `reference.ReferenceOperations` and `bands.BandedOperations`.

T is the array type of an implementation: offset fields are float32 (h, w, 2), costs float32 (h, w), images bytes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.frames import Plane
from pipeline.synthesis.energy import TAP_WEIGHT_SCALE, Energy, tables
from pipeline.synthesis.images import StyleImage, Target

T = TypeVar("T")
RandomKey = tuple[int, int]
"""Key of the Philox random number generator: (seed, stream), 32 bits each."""


@dataclass
class LoadedStyle(Generic[T]):
    """A style, in arrays of the implementation.

    Attributes:
        features: style features, padded by `energy.pad` px.
        tap_indices: patch taps of each rotation, as pixel indices of the padded style.
        tap_positions: patch taps of each rotation, see `energy.tap_table`.
        colours: `style.colours` in device memory; None until the first call of `antialiased`.
    """

    style: StyleImage
    energy: Energy
    features: T
    bins: T
    usable: T
    distance: T
    tap_indices: T
    tap_positions: T
    colours: T | None = None

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the style, px."""
        return self.style.size


@dataclass
class FrameState(Generic[T]):
    """A frame, in arrays of the implementation, with all data that its cost depends on. Absent terms are None.

    Attributes:
        size: (width, height), px.
        packed: colours of the most recently rendered offsets, and guides, with a margin of `energy.radius` px.
        field: the most recently rendered offsets, rounded to int16, with the same margin.
        bins: direction of each pixel, uint8 (h, w).
        distance: distance to the nearest line, px, float32 (h, w).
        advected: advected offsets, as candidates; NOWHERE = none.
        advected_colours: advected colours for eq. 6 and 7, uint8 (h, w, 4); the fourth channel is 0 at pixels without
            a colour.
        ribbons: corresponding positions in the style for the previous and the next keyframe, float32 (2, h, w, 2).
        fixed: fixed offsets; NOWHERE = the pixel is free.
        before: offsets before the previous iteration. Pixels whose offsets, and those of the pixels that propose
            candidates to them, are the same keep them. None = all pixels are improved.
    """

    size: tuple[int, int]
    packed: T
    field: T
    bins: T | None = None
    distance: T | None = None
    advected: T | None = None
    advected_colours: T | None = None
    ribbons: T | None = None
    fixed: T | None = None
    before: T | None = None


@dataclass(frozen=True)
class Search:
    """Parameters of one iteration: its candidates, and the key of its random numbers.

    Attributes:
        round: number of the iteration.
        jump: distance of four further neighbours that propose candidates besides the four direct ones, px; 1 = none.
        search_px: radius of the first random candidate, px.
        ribbon_px: radius of the random candidates around a ribbon's end, px.
        top: first row of a band within the frame; random numbers depend on the row within the frame.
    """

    key: RandomKey
    round: int = 0
    jump: int = 1
    search_px: float = 8.0
    ribbon_px: float = 3.0
    top: int = 0


class Operations(Protocol[T]):
    """Synthesis operations, documented in `opencl.OpenCLOperations`. Sizes are (width, height) px."""

    def upload(self, array: AnyArray) -> T: ...
    def fetch(self, array: T) -> AnyArray: ...
    def finish(self) -> None: ...
    def load(self, style: StyleImage, energy: Energy) -> LoadedStyle[T]: ...
    def prepare(self, style: LoadedStyle[T], target: Target) -> FrameState[T]: ...
    def random_offsets(self, style: LoadedStyle[T], size: tuple[int, int], key: RandomKey) -> T: ...
    def render(self, style: LoadedStyle[T], state: FrameState[T], offsets: T, votes: bool = False) -> None: ...
    def add_change(
        self, style: LoadedStyle[T], state: FrameState[T], advected: T, guides: AnyArray, visible: T
    ) -> None: ...
    def penalty(self, style: LoadedStyle[T], size: tuple[int, int], offsets: T) -> T: ...
    def improve(
        self, style: LoadedStyle[T], state: FrameState[T], offsets: T, penalty: T | None, search: Search
    ) -> T: ...
    def advect(
        self, style: LoadedStyle[T], state: FrameState[T], offsets: T, bins: T | None, displacement: T, visible: T
    ) -> T: ...
    def upsample(
        self, coarse: LoadedStyle[T], state: FrameState[T], offsets: T, style: LoadedStyle[T], to: FrameState[T]
    ) -> T: ...
    def merge(
        self,
        style: LoadedStyle[T],
        size: tuple[int, int],
        first: T,
        second: T,
        probability: float | Plane,
        key: RandomKey,
    ) -> T: ...
    def colours_at(self, style: LoadedStyle[T], size: tuple[int, int], offsets: T) -> T: ...
    def apply_fixed(self, style: LoadedStyle[T], size: tuple[int, int], fixed: T, offsets: T) -> T: ...
    def antialiased(self, style: LoadedStyle[T], state: FrameState[T], offsets: T, paintable: T | None) -> T: ...


ITERATION = np.dtype(
    [("coherence_limit", "i4"), ("coherence_weight", "f4"), ("temporal_weight", "f4"), ("kept_cost", "f4"),
     ("line_limit", "f4"), ("line_weight", "f4"),
     ("jump", "i4"), ("search_px", "f4"), ("ribbon_px", "f4"), ("seed", "u4"), ("stream", "u4"), ("round", "u4"),
     *((name, "i4") for name in ("top", "style_width", "style_height", "width", "height"))]
)  # fmt: skip
"""Layout of the struct `Iteration` in patchmatch.cl."""


def iteration(style: LoadedStyle[T], size: tuple[int, int], search: Search) -> np.void:
    """The parameters of an iteration as a record, for the kernel and the reference implementation."""
    energy, made = style.energy, tables(style.energy)
    values = (
        round(energy.r_max_px2), energy.w_sc * made.unit / TAP_WEIGHT_SCALE, energy.w_tc / energy.colours * made.centre,
        energy.kept_cost, energy.d_max_px, energy.w_dt * made.centre, search.jump, search.search_px, search.ribbon_px,
        *key_words(search.key), search.round, search.top, *style.size, *size,
    )  # fmt: skip
    numbers: np.void = np.array(values, ITERATION)[()]  # type: ignore[assignment]
    return numbers


def key_words(key: RandomKey) -> tuple[int, int]:
    """The two 32-bit words of a key."""
    return key[0] & 0xFFFFFFFF, key[1] & 0xFFFFFFFF

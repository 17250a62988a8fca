"""The operations synthesis is made of, whatever they run on: `opencl.Kernels`, or `reference.Reference`.

T is an array where the operations run: offset fields float32 (h, w, 2), costs float32 (h, w), images as bytes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from numpy.typing import NDArray

from pipeline.synthesis.goal import Goal
from pipeline.synthesis.images import Style, Target

T = TypeVar("T")
Key = tuple[int, int]
"""Of Philox: (seed, stream), 32 bits each."""


@dataclass
class Loaded(Generic[T]):
    """A style where the operations run."""

    style: Style
    goal: Goal
    features: T
    """Padded by `goal.pad`."""
    bins: T
    usable: T
    distance: T
    turns: T
    """Taps as pixels in the padded style."""
    steps: T

    @property
    def size(self) -> tuple[int, int]:
        return self.style.size


@dataclass
class Sitting(Generic[T]):
    """A frame where the operations run, with all that its cost depends on. Absent terms are None."""

    size: tuple[int, int]
    packed: T
    """Colours (of the offsets rendered last) and guides, with a margin of `goal.radius`."""
    field: T
    """The offsets rendered last, rounded, with the same margin: shorts."""
    bins: T | None = None
    distance: T | None = None
    was: T | None = None
    """Advected offsets, NOWHERE where there are none."""
    before: T | None = None
    """Advected colours, uint8 (h, w, 4), the fourth 0 where there are none: eq. 6 and 7."""
    past: Past[T] | None = None
    ribbons: T | None = None
    """float32 (2, h, w, 2): corresponding places in the style of the last and the next key."""
    given: T | None = None
    """Offsets that are not to be changed, NOWHERE where they are free."""


@dataclass
class Past(Generic[T]):
    """What eq. 10 compares with."""

    packed: T
    """The other frame's colours and guides as seen from here, with a margin."""
    visible: T
    """uint8, with a margin: 0 where a pixel is not seen in the other frame."""


class Operations(Protocol[T]):
    """See `opencl.Kernels` for what each does; sizes are (width, height) px."""

    def upload(self, array: NDArray[Any]) -> T: ...
    def fetch(self, array: T) -> NDArray[Any]: ...
    def finish(self) -> None: ...
    def load(self, style: Style, goal: Goal) -> Loaded[T]: ...
    def margined(self, plane: NDArray[Any], margin_px: int) -> T: ...
    def seat(self, style: Loaded[T], target: Target) -> Sitting[T]: ...
    def scatter(self, style: Loaded[T], size: tuple[int, int], key: Key) -> T: ...
    def render(self, style: Loaded[T], sitting: Sitting[T], offsets: T) -> None: ...
    def penalty(self, style: Loaded[T], size: tuple[int, int], offsets: T) -> T: ...
    def improve(
        self,
        style: Loaded[T],
        sitting: Sitting[T],
        offsets: T,
        penalty: T | None,
        key: Key,
        round_: int,
        search: Search,
    ) -> T: ...
    def advect(self, style: Loaded[T], sitting: Sitting[T], offsets: T, bins: T | None, way: T, visible: T) -> T: ...
    def upsample(self, coarse: Loaded[T], sitting: Sitting[T], offsets: T, style: Loaded[T], to: Sitting[T]) -> T: ...
    def merge(self, style: Loaded[T], size: tuple[int, int], first: T, second: T, share: float, key: Key) -> T: ...
    def recall(self, style: Loaded[T], size: tuple[int, int], offsets: T) -> T: ...
    def impose(self, style: Loaded[T], size: tuple[int, int], given: T, offsets: T) -> T: ...


@dataclass(frozen=True)
class Search:
    """Where an iteration looks."""

    jump: int = 1
    """Candidates come from the four neighbours, and from the four at this distance, px."""
    search_px: float = 8.0
    """Radius of the first random draw."""
    ribbon_px: float = 3.0
    """Radius of the draw around a ribbon's end."""

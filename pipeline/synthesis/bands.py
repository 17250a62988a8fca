"""Synthesis of frames that do not fit into the device's memory: improved there in bands of rows, the rest in memory.

Every pixel is improved against the picture of the round before, so that rows need nothing of each other's results:
with as many rows above and below as a candidate comes from, a band gives the same bytes as the whole frame, and there
are no seams. What costs little (moving, merging, showing offsets) is done by the specification, which agrees with the
kernels to the last bit. So the device holds the style and one band, whatever the size of the frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.compute import Device, DeviceArray
from pipeline.synthesis.engine import FARTHEST_PX
from pipeline.synthesis.goal import Goal
from pipeline.synthesis.images import TAIL, Style
from pipeline.synthesis.opencl import Kernels
from pipeline.synthesis.operations import Key, Loaded, Past, Search, Sitting
from pipeline.synthesis.reference import Reference

Array = NDArray[Any]


@dataclass
class Lent(Loaded[Array]):
    """A style in memory, and on the device as well."""

    there: Loaded[DeviceArray] | None = None


class Bands(Reference):
    """The operations of `operations.Operations` in memory, but for `improve`.

    Args:
        device: where bands are improved.
        pixels: of a band, its surroundings included, at most.
    """

    def __init__(self, device: Device, pixels: int) -> None:
        self.device = device
        self._kernels = Kernels(device)
        self._pixels = pixels

    def load(self, style: Style, goal: Goal) -> Loaded[Array]:
        here = super().load(style, goal)
        return Lent(**vars(here), there=self._kernels.load(style, goal))

    def improve(
        self, style: Loaded[Array], sitting: Sitting[Array], offsets: Array, penalty: Array | None, key: Key,
        round_: int, search: Search,
    ) -> Array:  # fmt: skip
        assert isinstance(style, Lent) and style.there is not None
        crowding = None if penalty is None else self._kernels.upload(penalty)
        out = np.empty_like(offsets)
        for start, stop in bands(sitting.size, self._pixels):
            first, last = max(0, start - FARTHEST_PX), min(sitting.size[1], stop + FARTHEST_PX)
            band = self._band(sitting, first, last, style.goal.radius)
            known = self._kernels.upload(offsets[first:last])
            found = self._kernels.improve(style.there, band, known, crowding, key, round_, search, first)
            out[start:stop] = self._kernels.fetch(found)[start - first : stop - first]
        return out

    def _band(self, sitting: Sitting[Array], first: int, last: int, radius: int) -> Sitting[DeviceArray]:
        """Rows [first, last) of a frame, on the device; what has a margin keeps it."""

        def rows(plane: Array | None) -> DeviceArray | None:
            return None if plane is None else self._kernels.upload(plane[first:last])

        def wide(plane: Array) -> DeviceArray:
            flat = plane[first : last + 2 * radius].reshape(-1)
            return self._kernels.upload(np.concatenate([flat, np.zeros(TAIL, plane.dtype)]))

        past = sitting.past
        return Sitting(
            (sitting.size[0], last - first), wide(sitting.packed), wide(sitting.field), rows(sitting.bins),
            rows(sitting.distance), rows(sitting.was), rows(sitting.before),
            None if past is None else Past(wide(past.packed), wide(past.visible)),
            None if sitting.ribbons is None else self._kernels.upload(sitting.ribbons[:, first:last]),
            rows(sitting.given),
        )  # fmt: skip


def bands(size: tuple[int, int], pixels: int) -> Iterator[tuple[int, int]]:
    """Rows [start, stop) of a frame's bands: as few as there can be, and as even.

    Args:
        size: (width, height) px.
        pixels: of a band with `FARTHEST_PX` rows above and below, at most; at least one row is taken.
    """
    width, height = size
    most = height if width * height <= pixels else max(1, pixels // width - 2 * FARTHEST_PX)
    count = -(-height // most)
    edges = [height * k // count for k in range(count + 1)]
    yield from pairwise(edges)

"""Synthesis of frames that do not fit into device memory: the search runs on the device in bands of rows.

Every pixel is improved with respect to the picture of the previous round, so rows of one round are independent. With
as many extra rows above and below as the farthest candidate needs, a band gives the same bytes as the whole frame, and
there are no seams. The cheap operations (advection, merging, rendering) run on the host in the reference
implementation, which is bit-identical to the kernels. The device thus holds only the style and one band.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.compute import Device, DeviceArray
from pipeline.synthesis.energy import Energy
from pipeline.synthesis.images import TAIL, StyleImage
from pipeline.synthesis.opencl import OpenCLOperations
from pipeline.synthesis.operations import FrameState, LoadedStyle, Search
from pipeline.synthesis.reference import ReferenceOperations
from pipeline.synthesis.refine import FARTHEST_PX

Array = AnyArray


@dataclass
class BandStyle(LoadedStyle[Array]):
    """A style in host memory, and the same style in device memory."""

    on_device: LoadedStyle[DeviceArray] | None = None


class BandedOperations(ReferenceOperations):
    """Implementation of `operations.Operations` in host memory, except for `improve`, which runs on the device.

    Args:
        device: compute device for `improve`.
        pixels: maximum number of pixels of a band, including its extra rows.
    """

    def __init__(self, device: Device, pixels: int) -> None:
        self.device = device
        self._kernels = OpenCLOperations(device)
        self._pixels = pixels

    def load(self, style: StyleImage, energy: Energy) -> LoadedStyle[Array]:
        on_host = super().load(style, energy)
        return BandStyle(**vars(on_host), on_device=self._kernels.load(style, energy))

    def improve(
        self, style: LoadedStyle[Array], state: FrameState[Array], offsets: Array, penalty: Array | None, search: Search
    ) -> Array:
        assert isinstance(style, BandStyle) and style.on_device is not None
        penalty_on_device = None if penalty is None else self._kernels.upload(penalty)
        out = np.empty_like(offsets)
        for start, stop in bands(state.size, self._pixels):
            first, last = max(0, start - FARTHEST_PX), min(state.size[1], stop + FARTHEST_PX)
            band = self._band(state, first, last, style.energy.radius)
            before = self._kernels.upload(offsets[first:last])
            found = self._kernels.improve(style.on_device, band, before, penalty_on_device, replace(search, top=first))
            out[start:stop] = self._kernels.fetch(found)[start - first : stop - first]
        return out

    def _band(self, state: FrameState[Array], first: int, last: int, radius: int) -> FrameState[DeviceArray]:
        """Upload the rows [first, last) of a frame; arrays with a margin keep their margin."""

        def rows(plane: Array | None) -> DeviceArray | None:
            return None if plane is None else self._kernels.upload(plane[first:last])

        def padded_rows(plane: Array) -> DeviceArray:
            flat = plane[first : last + 2 * radius].reshape(-1)
            return self._kernels.upload(np.concatenate([flat, np.zeros(TAIL, plane.dtype)]))

        return FrameState(
            (state.size[0], last - first), padded_rows(state.packed), padded_rows(state.field), rows(state.bins),
            rows(state.distance), rows(state.advected), rows(state.advected_colours),
            None if state.ribbons is None else self._kernels.upload(state.ribbons[:, first:last]),
            rows(state.fixed), rows(state.before),
        )  # fmt: skip


def bands(size: tuple[int, int], pixels: int) -> Iterator[tuple[int, int]]:
    """Split a frame into the smallest number of bands, of nearly equal height; yields their rows [start, stop).

    Args:
        size: (width, height) of the frame, px.
        pixels: maximum number of pixels of a band with `FARTHEST_PX` extra rows above and below. A band has at least
            one row even if it exceeds this maximum.
    """
    width, height = size
    most = height if width * height <= pixels else max(1, pixels // width - 2 * FARTHEST_PX)
    count = -(-height // most)
    edges = [height * k // count for k in range(count + 1)]
    yield from pairwise(edges)

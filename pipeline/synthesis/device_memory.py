"""Choice between synthesis of whole frames and of bands of rows, by the memory of the device."""

from __future__ import annotations

import logging
from typing import Any

from pipeline.compute import Device
from pipeline.errors import DeviceError
from pipeline.synthesis.bands import BandedOperations, bands
from pipeline.synthesis.images import Bytes
from pipeline.synthesis.opencl import OpenCLOperations
from pipeline.synthesis.operations import Operations

_LOG = logging.getLogger(__name__)

FRAME_BYTES = 120
"""Memory of the current frame, bytes per pixel: packed colours and guides, offsets before and after, motion, ribbons,
costs."""
PREPARED_BYTES = 25
"""Memory of the next frame, which is prepared meanwhile, bytes per pixel: packed pixels, rounded offsets, direction,
distance."""
OFFSET_BYTES = 12
"""Memory of the offsets of every other frame, bytes per pixel."""
STYLE_BYTES = 28
"""Memory of the style, bytes per pixel: packed pixels, directions, distances, histogram."""
_MIN_ROWS = 64
"""Minimum number of rows of a band; a smaller band would consist mostly of its margin."""


def operations(device: Device, size: tuple[int, int], style: Bytes, frames: int) -> tuple[Operations[Any], str]:
    """The operations for a task, and a message if the frames are synthesised in bands of rows.

    Whole frames and bands give the same bytes.

    Args:
        size: (width, height) of the frames, px.
        style: style output at full size, uint8 (h, w, channels).
        frames: number of frames whose offsets are in device memory at the same time.

    Raises:
        DeviceError: the style and 64 rows do not fit.
    """
    style_bytes = int(style.shape[0] * style.shape[1]) * STYLE_BYTES
    frame_bytes = FRAME_BYTES + PREPARED_BYTES + frames * OFFSET_BYTES
    needed = _all_levels(size[0] * size[1] * frame_bytes + style_bytes)
    available = device.memory_bytes
    if needed <= available:
        return OpenCLOperations(device), ""
    pixels = (available * 3 // 4 - style_bytes) // FRAME_BYTES
    least = _all_levels(size[0] * _MIN_ROWS * FRAME_BYTES + style_bytes)
    if available < least:
        raise DeviceError(
            f"Frames of {size[0]}x{size[1]} with this style do not fit into the memory of {device.name}, not even in "
            "bands of rows.",
            field="device", value=f"{_mib(least)} needed, {_mib(available)} available",
            remedy="Use a smaller painting, fewer keyframes per shot, or the CPU.",
        )  # fmt: skip
    count = sum(1 for _ in bands(size, pixels))
    message = (
        f"Frames of {size[0]}x{size[1]} with this style need {_mib(needed)}, and {device.name} has {_mib(available)}. "
        f"They stay in main memory and are synthesised in {count} {'band' if count == 1 else 'bands'} of rows, one "
        "after the other. This takes longer and does not change the result."
    )
    _LOG.warning(message)
    return BandedOperations(device, pixels), message


def _all_levels(finest: int) -> int:
    """Memory of all levels of a pyramid, bytes, from that of the finest."""
    return 4 * finest // 3


def _mib(count: int) -> str:
    return f"{count / 2**20:.0f} MiB"

"""What a task takes of the device's memory, and what is done where that is not there."""

from __future__ import annotations

import logging
from typing import Any

from pipeline.compute import Device
from pipeline.errors import DeviceError
from pipeline.synthesis.bands import Bands, bands
from pipeline.synthesis.images import Bytes
from pipeline.synthesis.opencl import Kernels
from pipeline.synthesis.operations import Operations

_LOG = logging.getLogger(__name__)

BYTES_AT_WORK = 120
"""A pixel of the frame being worked at: packed colours and guides, offsets before and after, motion, ribbons, costs."""
BYTES_HELD = 12
BYTES_OF_STYLE = 28
"""A pixel of the style: packed, directions, distances, histogram."""
_LEAST_ROWS = 64
"""A band with fewer would be little but its surroundings."""


def operations(on: Device, size: tuple[int, int], style: Bytes, held: int) -> tuple[Operations[Any], str]:
    """What a task synthesises with: the device alone, or the device band by band; and then a sentence that says so.

    Both give the same bytes.

    Args:
        size: (width, height) of the frames, px.
        style: at full size.
        held: frames whose offsets are kept at once.

    Raises:
        DeviceError: not even the style and a few rows fit; how much is needed and how much there is.
    """
    needed, there = _with_levels(size[0] * size[1] * (BYTES_AT_WORK + held * BYTES_HELD) + _of(style)), on.memory_bytes
    if needed <= there:
        return Kernels(on), ""
    pixels = (there * 3 // 4 - _of(style)) // BYTES_AT_WORK
    least = _with_levels(size[0] * _LEAST_ROWS * BYTES_AT_WORK + _of(style))
    if there < least:
        raise DeviceError(
            f"Frames of {size[0]}x{size[1]} with this style do not fit into the memory of {on.name}, not even in bands "
            "of rows.",
            field="device", value=f"{_mib(least)} needed, {_mib(there)} there",
            remedy="Give a smaller painting, paint fewer keys for one shot, or use the CPU.",
        )  # fmt: skip
    count = sum(1 for _ in bands(size, pixels))
    says = (
        f"Frames of {size[0]}x{size[1]} with this style need {_mib(needed)}, and {on.name} has {_mib(there)}: each "
        f"waits in main memory and is painted in {count} {'band' if count == 1 else 'bands'} of rows, one after the "
        "other. That takes longer and changes nothing in the result."
    )
    _LOG.warning(says)
    return Bands(on, pixels), says


def _with_levels(finest: int) -> int:
    """All levels of a pyramid together."""
    return 4 * finest // 3


def _of(style: Bytes) -> int:
    return int(style.shape[0] * style.shape[1]) * BYTES_OF_STYLE


def _mib(count: int) -> str:
    return f"{count / 2**20:.0f} MiB"

"""Chooses how a task uses the device: whole frames, or bands of rows when memory is short."""

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
"""Bytes a pixel of the current frame: packed colours and guides, offsets before and after, motion, ribbons, costs."""
BYTES_HELD = 12
BYTES_OF_STYLE = 28
"""Bytes a pixel of the style: packed pixels, directions, distances, histogram."""
_LEAST_ROWS = 64
"""Minimum rows of a band; a smaller band would consist mostly of its margin."""


def operations(on: Device, size: tuple[int, int], style: Bytes, held: int) -> tuple[Operations[Any], str]:
    """The operations for a task (whole frames, or bands of rows), and a message if bands are used.

    Both give the same bytes.

    Args:
        size: (width, height) of the frames, px.
        style: at full size.
        held: number of frames whose offsets are in device memory at the same time.

    Raises:
        DeviceError: the style and a few rows do not fit.
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
            field="device", value=f"{_mib(least)} needed, {_mib(there)} available",
            remedy="Give a smaller painting, paint fewer keys for one shot, or use the CPU.",
        )  # fmt: skip
    count = sum(1 for _ in bands(size, pixels))
    message = (
        f"Frames of {size[0]}x{size[1]} with this style need {_mib(needed)}, and {on.name} has {_mib(there)}: each "
        f"waits in main memory and is painted in {count} {'band' if count == 1 else 'bands'} of rows, one after the "
        "other. That takes longer and changes nothing in the result."
    )
    _LOG.warning(message)
    return Bands(on, pixels), message


def _with_levels(finest: int) -> int:
    """Memory of all levels of a pyramid."""
    return 4 * finest // 3


def _of(style: Bytes) -> int:
    return int(style.shape[0] * style.shape[1]) * BYTES_OF_STYLE


def _mib(count: int) -> str:
    return f"{count / 2**20:.0f} MiB"

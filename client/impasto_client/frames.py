"""Arrays as a file that can be uploaded, and a result's frames as arrays. Needs NumPy 1.26 or later.

write_frames("shot.zip", images, fps=24)          # images: (height, width, 1, 3 or 4)
video = client.upload("shot.zip")
...                                               # a job with {"output": {"format": "png"}}
for image in read_frames(client.download(job["id"], "result.zip")):
    ...
"""

from __future__ import annotations

import json
import struct
import zipfile
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from impasto_client.errors import BadFrame

_COLOUR_TYPES = {1: 0, 3: 2, 4: 6}
"""Channels -> colour type of PNG: gray, RGB, RGBA."""
_ROWS_UP = b"\x02"
"""PNG's filter "up": the difference from the row above."""


def write_frames(path: str | Path, frames: Iterable[Any], fps: float = 24.0, first: int = 0) -> int:
    """Write arrays as a zip of numbered PNG files, which the service reads as a video; return their number.

    Args:
        path: the zip; an existing one is replaced.
        frames: arrays (height, width, channels) of 1 (gray), 3 (RGB) or 4 (RGBA, colours not multiplied by the
            opacity) channels, or (height, width); uint8, uint16, or floats from 0 to 1, which are clipped and become 16
            bits.
        fps: frames per second.
        first: number of the first frame.

    Raises: BadFrame.
    """
    count = 0
    with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr("sequence.json", json.dumps({"fps": fps}))
        for count, frame in enumerate(frames, 1):
            archive.writestr(f"{first + count - 1:07d}.png", png(frame, count - 1))
    return count


def read_frames(path: str | Path) -> Iterator[Any]:
    """The frames of a "png" result (a zip) in order, uint8 (height, width, 3 or 4). Needs Pillow."""
    from PIL import Image

    with zipfile.ZipFile(path) as archive:
        for name in sorted(name for name in archive.namelist() if name.endswith(".png")):
            with archive.open(name) as file:
                yield np.asarray(Image.open(file))


def png(frame: Any, index: int = 0) -> bytes:
    """An array as a PNG file; its kinds are those of `write_frames`. Raises: BadFrame, about `frames[index]`."""
    frame = np.asarray(frame)
    if np.issubdtype(frame.dtype, np.floating):
        frame = (np.clip(np.nan_to_num(frame), 0, 1) * 65535 + 0.5).astype(np.uint16)
    pixels = frame[..., None] if frame.ndim == 2 else frame
    if pixels.dtype not in (np.uint8, np.uint16) or pixels.ndim != 3 or pixels.shape[2] not in _COLOUR_TYPES:
        raise BadFrame(
            "It is not a picture.", field=f"frames[{index}]", value=f"{frame.dtype} {frame.shape}",
            remedy="Give uint8, uint16 or floats from 0 to 1, (height, width, 1, 3 or 4).",
        )  # fmt: skip
    height, width, channels = pixels.shape
    rows = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder(">")).view(np.uint8).reshape(height, -1)
    packed = np.empty((height, rows.shape[1] + 1), np.uint8)
    packed[:, 0] = _ROWS_UP[0]
    packed[0, 1:], packed[1:, 1:] = rows[0], rows[1:] - rows[:-1]
    head = struct.pack(">IIBBBBB", width, height, 8 * pixels.dtype.itemsize, _COLOUR_TYPES[channels], 0, 0, 0)
    chunks = ((b"IHDR", head), (b"IDAT", zlib.compress(packed.tobytes(), 1)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(kind, data) for kind, data in chunks)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

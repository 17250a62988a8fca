"""Files of the passes of methods: images with a layer for each pass, or PNG.

A method hands out arrays by name (`TaskContext.emit_passes`) and knows nothing of files. Values are those of the frame
at full size: a flow is in px of the frame, whatever the size of its array, which is enlarged here.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path

import cv2
import numpy as np

from pipeline.arrays import AnyArray
from pipeline.errors import BadFrame
from pipeline.formats import planes_format
from pipeline.formats.png import PNG
from pipeline.passes.made import MadePass
from pipeline.video.writer import zip_entry

_WHITE = 65535


class PassArchive:
    """A zip of the passes of frames, in a file.

    Args:
        made: the passes, which decide about names of channels.
        form: one of `PASS_FORMATS`; "": the first one.
        size: (width, height) of the frames, px.
    """

    def __init__(self, path: Path, made: Iterable[MadePass], form: str, size: tuple[int, int]) -> None:
        self._made = {one.name: one for one in made}
        self._is_png = form == PNG.name
        self._size = size
        self._zip = zipfile.ZipFile(path, "w")

    def add(self, number: int, arrays: Mapping[str, AnyArray]) -> None:
        """Add a frame: its number, and its passes by name, each (h, w) or (h, w, channels) of any size.

        Raises: BadFrame, if an array does not fit its pass.
        """
        planes = {name: _fitted(self._made[name], arrays[name], self._size) for name in sorted(arrays)}
        if self._is_png:
            for name, values in planes.items():
                self._zip.writestr(zip_entry(f"{name}/{number:05d}.png"), _png(self._made[name], values))
            return
        form = planes_format()
        channels = {
            f"{name}.{channel}": values[..., k]
            for name, values in planes.items()
            for k, channel in enumerate(self._made[name].channels)
        }
        self._zip.writestr(zip_entry(f"{number:05d}{form.suffixes[0]}"), form.written(channels))

    def close(self) -> None:
        """Complete the file."""
        self._zip.close()


def _fitted(made: MadePass, array: AnyArray, size: tuple[int, int]) -> AnyArray:
    """The pass at the size of the frame, uint32 or float32 (h, w, channels)."""
    values = array[..., None] if array.ndim == 2 else array
    whole = np.issubdtype(values.dtype, np.integer)
    if values.ndim != 3 or values.shape[2] != len(made.channels) or whole != made.ids:
        raise BadFrame(f"The pass {made.name!r} has other channels or another type than its description.",
                       field=f"passes.{made.name}", value=f"{array.dtype} {array.shape}")  # fmt: skip
    if values.shape[1::-1] == size:
        return np.asarray(values, np.uint32 if whole else np.float32)
    if whole:
        rows, columns = (np.arange(n) * have // n for n, have in zip(size[::-1], values.shape[:2], strict=True))
        return np.asarray(values[rows[:, None], columns], np.uint32)
    single = np.ascontiguousarray(values, np.float32)
    return np.asarray(cv2.resize(single, size, interpolation=cv2.INTER_LINEAR)).reshape(*size[::-1], -1)


def _png(made: MadePass, values: AnyArray) -> bytes:
    if made.ids:
        number = values[..., 0]
        shown = np.dstack([number & _WHITE, number >> 16, np.zeros_like(number)])
    else:
        zero, scale = made.png_zero, made.png_scale
        shown = np.clip(np.rint(values * np.float32(scale) + np.float32(zero)), 0, _WHITE)
        if shown.shape[2] == 2:
            shown = np.dstack([shown, np.zeros_like(shown[..., :1])])
    return cv2.imencode(".png", np.ascontiguousarray(shown[..., ::-1], np.uint16))[1].tobytes()

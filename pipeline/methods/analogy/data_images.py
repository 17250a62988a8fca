"""Images that are data and not pictures: guides, directions of strokes, lines, masks.

Planes of an image with planes are read as they are stored, without colour coding: 0 is black and 1 is white. Pixels of
other images are 8 or 16 bits of the same range.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.errors import BadInput
from pipeline.formats import has_planes
from pipeline.formats.base import PlaneImage
from pipeline.frames import Frame, Plane
from pipeline.methods.analogy.inputs import id_colours
from pipeline.passes.find import Where, depth, normals, position, uv
from pipeline.passes.sequence import labels_of
from pipeline.synthesis.images import Bytes
from pipeline.video.guard.pictures import guarded_planes, guarded_raw
from pipeline.video.passes import data_channels

Range = tuple[float, float]
UNIT: Range = (0.0, 1.0)
_BACKGROUND = 1e9
"""Absolute value from which a value is no measurement: renderers write 1e10 as the depth of the empty background."""


def read_data(files: Mapping[str, bytes], path: str) -> AnyArray:
    """The data of a file: uint8 or uint16 as stored, or float32 (h, w, 1 to 3) of an image with planes."""
    return plane_data(guarded_planes(files[path], path), path) if has_planes(path) else guarded_raw(files[path], path)


def plane_data(image: PlaneImage, path: str) -> Plane:
    """The channels of an image with planes that are its data, float32 (h, w, 1 to 3), see `data_channels`.

    Raises:
        BadInput: it has more than three channels, and none of them is known by its name.
    """
    names = data_channels(image)
    if not names:
        raise BadInput(
            "It is not known which channels of the image are its data.", field=path, value=", ".join(image.planes),
            remedy="Name them R, G, B, or X, Y, Z, or U, V, or save at most three.",
        )  # fmt: skip
    return np.stack([image.planes[name] for name in names], -1)


def unit_data(data: AnyArray) -> Plane:
    """Data as float32: 8 or 16 bits become 0..1, float values stay as they are."""
    most = {np.dtype(np.uint8): 255, np.dtype(np.uint16): 65535}.get(data.dtype, 1)
    return np.asarray(data, np.float32) / np.float32(most)


def range_of(images: Iterable[AnyArray]) -> Range:
    """The range of values that images of data share: at least 0..1, and no value outside.

    Values that are not finite, or that stand for the empty background, do not count.
    """
    least, most = UNIT
    for data in images:
        if data.dtype in (np.uint8, np.uint16):
            continue
        known = data[np.isfinite(data) & (np.abs(data) < _BACKGROUND)]
        least, most = min(least, float(known.min(initial=least))), max(most, float(known.max(initial=most)))
    return least, most


def data_picture(data: AnyArray, limits: Range = UNIT) -> Frame:
    """Data as 8 bits, uint8 (h, w, 3); `limits` become 0 and 255. A second channel without a third has 0 as the third.

    Data of 8 bits in the range 0..1 are not changed.
    """
    if limits == UNIT and data.dtype in (np.uint8, np.uint16):
        eight: Bytes = np.asarray(data if data.dtype == np.uint8 else data >> 8, np.uint8)
    else:
        scaled = (np.nan_to_num(unit_data(data), nan=limits[0]) - limits[0]) / (limits[1] - limits[0])
        eight = np.asarray(np.rint(scaled.clip(0, 1) * 255), np.uint8)
    planes = eight[..., None] if eight.ndim == 2 else eight[..., :3]
    missing = {1: [0, 0, 0], 2: [0, 1]}.get(planes.shape[2], [0, 1, 2])
    chosen = planes[..., missing]
    return np.ascontiguousarray(chosen if len(missing) == 3 else np.dstack([chosen, np.zeros_like(planes[..., :1])]))


def direction_data(files: Mapping[str, bytes], path: str) -> AnyArray:
    """A picture of directions for `authored_tensors`: 8 bits, or float32 (h, w, 2) of an image with planes.

    Channels named X and Y are components of the vector, -1 to 1; others are coded as 8 bits are: 0.5 means 0.
    """
    data = read_data(files, path)
    if data.dtype in (np.uint8, np.uint16):
        return data_picture(data)
    if data.shape[2] < 2:
        raise BadInput(
            "An image of directions needs two channels.", field=path, value=data.shape[2],
            remedy="Save red = x and green = y, or channels named X and Y.",
        )  # fmt: skip
    signed = data_channels(guarded_planes(files[path], path))[0].rpartition(".")[2].lower() == "x"
    vectors = np.nan_to_num(data[..., :2])
    return np.ascontiguousarray(vectors if signed else vectors * np.float32(2) - np.float32(1))


# -- passes that are known by the names of their channels

FLOAT_PASSES = ("depth", "position", "uv")
"""Passes that are guides in floating point, where the style or the user names them."""
PASSES_IN_FRAMES: Mapping[str, Callable[[PlaneImage, Where], AnyArray | None]] = {
    "normals": normals, "ids": labels_of, "depth": depth, "position": position, "uv": uv,
}  # fmt: skip


def normal_colours(found: AnyArray) -> Frame:
    """Normals, components -1 to 1, as colours, uint8 (h, w, 3)."""
    return np.asarray(np.rint((np.nan_to_num(found).clip(-1, 1) + 1) * 127.5), np.uint8)


PASS_COLOURS: Mapping[str, Callable[[AnyArray], Frame]] = {"normals": normal_colours, "ids": id_colours}

"""Arrays that `impasto.render` gets as frames: 8, 16 bits or floats, with or without opacity."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.errors import BadFrame, BadInput
from pipeline.frames import MIN_SIDE_PX, Frame, same_size
from pipeline.methods.base import VideoInfo
from pipeline.video.depth import DTYPES, as_float, as_uint8, as_uint16, with_opacity
from pipeline.video.media import Opacity, SourceOptions
from pipeline.video.opacity import as_frame

_BRIGHT = 16
"""A frame of floats is refused if half of it is brighter, times white: then white is not 1, but probably 255."""
_AS: dict[str, Callable[[AnyArray], AnyArray]] = {"uint8": as_uint8, "uint16": as_uint16, "float32": as_float}


def picture_of(array: object, field: str) -> AnyArray:
    """The array as a picture (height, width, 3 or 4), uint8, uint16 or float32.

    Args:
        array: (height, width), (height, width, 3) or (height, width, 4) with straight opacity; uint8, uint16, or floats
            with white at 1; at least 16 px on each side.

    Raises: BadFrame.
    """
    if not isinstance(array, np.ndarray):
        raise BadFrame("A frame is a NumPy array.", field=field, value=type(array).__name__)
    picture = array.astype(np.float32) if np.issubdtype(array.dtype, np.floating) else array
    if picture.dtype not in DTYPES:
        remedy = "Give uint8, uint16, or floats with white at 1."
        raise BadFrame(
            "A frame has whole numbers without sign, or floats.", field=field, value=array.dtype, remedy=remedy
        )
    if picture.ndim == 2:
        picture = np.dstack([picture] * 3)
    if picture.ndim != 3 or picture.shape[2] not in (3, 4):
        remedy = "Give (height, width, 3), or 4 channels with opacity, or (height, width)."
        raise BadFrame("A frame has three or four channels.", field=field, value=array.shape, remedy=remedy)
    if min(picture.shape[:2]) < MIN_SIDE_PX:
        size = f"{picture.shape[1]}x{picture.shape[0]}"
        raise BadFrame(
            f"A frame is at least {MIN_SIDE_PX} px on each side.", field=field, value=size, remedy="Use a larger video."
        )
    if picture.dtype == np.float32 and (median := float(np.median(picture[::8, ::8, :3]))) > _BRIGHT:
        raise BadFrame(
            "Floats have white at 1; half of this frame is far above it.", field=field,
            value=f"median {median:g}", remedy="Divide by the value of white, for example 255, or give uint8.",
        )  # fmt: skip
    return np.ascontiguousarray(picture)


def checked(arrays: Iterator[AnyArray]) -> Iterator[AnyArray]:
    """The arrays as pictures. Raises BadFrame unless each has the size, the type and the channels of the first one."""
    first: AnyArray | None = None
    for index, array in enumerate(arrays):
        field = f"source[{index}]"
        picture = picture_of(array, field)
        first = picture if first is None else first
        same_size(picture, (first.shape[1], first.shape[0]), field)
        if (picture.dtype, picture.shape) != (first.dtype, first.shape):
            raise BadFrame(
                "Every frame of a video has one type and one number of channels.", field=field,
                value=f"{picture.dtype} {picture.shape} instead of {first.dtype} {first.shape}",
            )  # fmt: skip
        yield picture


def frame_of(picture: AnyArray, opacity: Opacity) -> Frame:
    """The picture with 8 bits: over white, as its own colours ("straight"), or its opacity ("matte")."""
    return as_uint8(as_frame(picture, SourceOptions(opacity=opacity)))


def returned(painted: AnyArray, picture: AnyArray) -> AnyArray:
    """A painted frame in the type of the source's picture, with its opacity."""
    if painted.dtype != picture.dtype:
        painted = _AS[picture.dtype.name](painted)
    return with_its_opacity(painted, picture)


def with_its_opacity(painted: AnyArray, picture: AnyArray) -> AnyArray:
    """A painted frame with the opacity of the source's picture, if that has any and the frame has none of its own."""
    return with_opacity(painted, picture[..., 3]) if picture.shape[2] > painted.shape[2] else painted


class SpooledFrames:
    """Pictures of an iterator as a `FrameSource`: written once to the file `path`, uncompressed, then read in any
    order. `opacity`: what frames show of pictures with opacity."""

    def __init__(self, pictures: Iterator[AnyArray], fps: float, path: Path, opacity: Opacity = "white") -> None:
        count, shape, dtype = 0, (0, 0, 3), np.dtype(np.uint8)
        with path.open("wb") as file:
            for picture in pictures:
                shape, dtype = picture.shape, picture.dtype
                file.write(picture.tobytes())
                count += 1
        if count == 0:
            raise BadInput("The source has no frames.", field="source", remedy="Give at least one.")
        self.pictures = np.memmap(path, dtype, "r", shape=(count, *shape))
        """All of them, (frames, height, width, 3 or 4)."""
        self.info = VideoInfo(shape[1], shape[0], count, fps, count / fps)
        self.has_alpha = shape[2] == 4
        self._opacity: Opacity = opacity

    def showing(self, opacity: Opacity) -> SpooledFrames:
        """The same pictures, of which frames show this."""
        other = copy.copy(self)
        other._opacity = opacity
        return other

    def read(self, start: int, stop: int | None) -> Iterator[Frame]:
        for index in range(start, self.info.frames if stop is None else min(stop, self.info.frames)):
            yield np.array(frame_of(self.pictures[index], self._opacity))

    def read_deep(self, start: int, stop: int | None) -> Iterator[AnyArray]:
        """Like `read`, in the type of the pictures."""
        for index in range(start, self.info.frames if stop is None else min(stop, self.info.frames)):
            yield np.array(as_frame(self.pictures[index], SourceOptions(opacity=self._opacity)))

"""OpenEXR images: reading of all channels of all parts as planes of the display window, and detection of passes.

Renderers use different pass names and different signs of motion vectors. Passes are identified by name: velocities
(Blender's Vector pass, Nuke's forward and backward, velocity and motion channels), normals, object ids and depth. Signs
that the name does not determine are estimated from two frames: the correct signs give the smallest warping error.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import cv2
import numpy as np
import OpenEXR
from numpy.typing import NDArray

from pipeline.arrays import AnyArray, Arrays
from pipeline.errors import BadInput, MediaTooLarge, UnreadableMedia
from pipeline.frames import Flow, Frame, Plane
from pipeline.video.media import Limits
from pipeline.video.memory_file import path_of

Convention = Literal["auto", "cycles", "eevee", "nuke"]
Planes = Mapping[str, Plane]
Linear = NDArray[np.float32]

EXR_MAGIC = b"\x76\x2f\x31\x01"
_BACK = (("x", "y"), ("u", "v"), ("r", "g"))
_VECTOR = (("x", "y", "z", "w"), ("r", "g", "b", "a"))
_FORTH_NAMES = ("forward", "motion_next", "velocity_next", "motionforward", "fwd", "velocity", "motion", "motionvector")
_BACK_NAMES = ("backward", "motion_previous", "velocity_previous", "motionbackward", "bwd", "back")
_PICTURES = ("combined", "beauty", "rgba", "image", "")
_NORMALS = ("normal", "n", "normals", "worldnormal", "cameranormal")
_IDS = ("indexob", "objectid", "id", "object_id", "objectindex", "object")
_DEPTHS = ("z", "depth", "mist")


@dataclass(frozen=True)
class Exr:
    """Decoded EXR image: (width, height) px, and float32 (h, w) planes by full channel name, "part.layer.pass.X"."""

    size: tuple[int, int]
    planes: Planes


def read_exr(source: bytes | Path, limits: Limits | None = None, name: str = "image") -> Exr:
    """Read all channels of an EXR file: half, float or integer; single-part or multi-part.

    Pixels of the display window outside the data window are 0.

    Raises:
        UnreadableMedia: the file is not an EXR, is damaged, or has deep or subsampled channels.
        MediaTooLarge: a window is larger than the limits allow.
    """
    if isinstance(source, bytes):
        with path_of(source, ".exr") as path:
            return read_exr(path, limits, name)
    _check_window(source, limits or Limits(), name)
    try:
        with OpenEXR.File(str(source), separate_channels=True) as file:
            parts = [(part.header, {n: c.pixels for n, c in part.channels.items()}) for part in file.parts]
            return _placed(parts, name)
    except UnreadableMedia:
        raise
    except Exception as error:  # the binding raises what OpenEXR's C++ does
        raise _unreadable(name, error) from error


def _unreadable(name: str, why: object) -> UnreadableMedia:
    return UnreadableMedia(
        "The EXR cannot be read.", field=name, value=why, remedy="Save it again as scanlines, with full channels."
    )


_WINDOW = re.compile(rb"(?:displayWindow|dataWindow)\0box2i\0\x10\0\0\0(.{16})", re.DOTALL)
_HEADER_BYTES = 1 << 20


def _check_window(path: Path, limits: Limits, name: str) -> None:
    """Check the windows in the header's bytes against the limits, before OpenEXR opens the file."""
    with path.open("rb") as stream:
        head = stream.read(_HEADER_BYTES)
    windows = [struct.unpack("<4i", found) for found in _WINDOW.findall(head)]
    if not head.startswith(EXR_MAGIC) or not windows:
        raise _unreadable(name, "not an EXR")
    for left, top, right, bottom in windows:
        width, height = right - left + 1, bottom - top + 1
        if width < 1 or height < 1:
            raise _unreadable(name, f"a window of {width}x{height}")
        if width * height > limits.pixels or max(width, height) > limits.side_px:
            raise MediaTooLarge(
                f"The image {name} has too many pixels.", field=name, value=f"{width}x{height}",
                remedy=f"At most {limits.pixels / 1e6:g} megapixels and {limits.side_px} px a side: scale it down.",
            )  # fmt: skip


def _extent(window: Any) -> tuple[int, int]:
    (left, top), (right, bottom) = window
    return int(right) - int(left) + 1, int(bottom) - int(top) + 1


def _placed(parts: Iterable[tuple[Mapping[str, Any], Arrays]], name: str) -> Exr:
    planes: dict[str, Plane] = {}
    size = (0, 0)
    for header, channels in parts:
        size = _extent(header["displayWindow"])
        prefix = f"{header['name']}." if header.get("name") else ""
        shift = np.array(header["dataWindow"][0]) - np.array(header["displayWindow"][0])
        for channel, pixels in channels.items():
            if pixels.ndim != 2 or pixels.shape[::-1] != _extent(header["dataWindow"]):
                raise _unreadable(name, f"channel {channel}: deep or subsampled")
            planes[_named(prefix, channel)] = _within(pixels, (int(shift[0]), int(shift[1])), size)
    if not planes:  # OpenEXR leaves out a part whose pixels it cannot decode
        raise _unreadable(name, "no channel could be decoded")
    return Exr(size, planes)


def _named(prefix: str, channel: str) -> str:
    return channel if channel.startswith(prefix) else prefix + channel


def _within(pixels: AnyArray, shift: tuple[int, int], size: tuple[int, int]) -> Plane:
    """Copy the pixels of the data window into the display window."""
    if shift == (0, 0) and pixels.shape[::-1] == size:
        return np.ascontiguousarray(pixels, np.float32)
    out = np.zeros(size[::-1], np.float32)
    (left, top), (height, width) = shift, pixels.shape
    x0, y0, x1, y1 = max(left, 0), max(top, 0), min(left + width, size[0]), min(top + height, size[1])
    if x1 > x0 and y1 > y0:
        out[y0:y1, x0:x1] = pixels[y0 - top : y1 - top, x0 - left : x1 - left]
    return out


# -- passes


def pixels(image: Exr) -> NDArray[np.uint8] | None:
    """The beauty pass, uint8 (h, w, 3), or (h, w, 4) with straight alpha if it has an alpha channel; None if it lacks
    R, G or B. Converts linear light, clipped to 0..1, to sRGB, and EXR's premultiplied colours to straight ones."""
    found = _group(image.planes, _PICTURES, ("r", "g", "b"))
    if found is None:
        return None
    alpha = _group(image.planes, _PICTURES, ("a",))
    linear: Linear = np.nan_to_num(np.stack(found, -1)).astype(np.float32)
    if alpha is None:
        return _eight_bit(_encoded(linear))
    clear = np.clip(np.nan_to_num(alpha[0]), 0, 1)[..., None]
    straight: Linear = (linear / np.maximum(clear, np.float32(1e-4))).astype(np.float32)
    return np.ascontiguousarray(np.concatenate([_eight_bit(_encoded(straight)), _eight_bit(clear)], -1))


def _encoded(linear: Linear) -> Linear:
    light = np.clip(linear, 0, 1)
    return np.where(light <= 0.0031308, light * 12.92, 1.055 * np.power(light, 1 / 2.4) - 0.055).astype(np.float32)


def _eight_bit(values: Linear) -> NDArray[np.uint8]:
    return np.asarray(np.rint(values * 255), np.uint8)


def normals(image: Exr) -> NDArray[np.float32] | None:
    """The normal pass, float32 (h, w, 3); None if there is no such pass."""
    found = _group(image.planes, _NORMALS, ("x", "y", "z")) or _group(image.planes, _NORMALS, ("r", "g", "b"))
    return None if found is None else np.stack(found, -1)


def object_ids(image: Exr) -> NDArray[np.int32] | None:
    """The object index pass, int32 (h, w); None if there is no such pass."""
    found = next((f for last in ("x", "y", "r", "id") if (f := _group(image.planes, _IDS, (last,)))), None)
    return None if found is None else np.rint(found[0]).astype(np.int32)


def depth(image: Exr) -> Plane | None:
    """The depth pass, float32 (h, w), in the renderer's unit; None if there is no such pass."""
    found = _group(image.planes, _DEPTHS, ("z",)) or _group(image.planes, ("",), ("z",))
    return None if found is None else found[0]


def _group(planes: Planes, passes: tuple[str, ...], channels: tuple[str, ...]) -> tuple[Plane, ...] | None:
    """The planes `channels` of the first pass named as one of `passes`, in any part or layer; None = not found."""
    by_name = {full.lower(): plane for full, plane in planes.items()}
    for wanted in passes:
        for full in by_name:
            stem, _, last = full.rpartition(".")
            if last == channels[0] and stem.rpartition(".")[2] == wanted:
                found = [by_name.get(f"{stem}.{c}" if stem else c) for c in channels]
                if all(plane is not None for plane in found):
                    return tuple(plane for plane in found if plane is not None)
    return None


@dataclass(frozen=True)
class Velocities:
    """V+ and V- of benard2013stylizing, px, y down: the point at p moves to p + plus(p) and came from p - minus(p)."""

    plus: Flow | None
    minus: Flow | None


def raw_vectors(image: Exr) -> tuple[str, Flow | None, Flow | None]:
    """Motion vectors as stored, without any change of sign or axis.

    Returns:
        The naming scheme ("blender" or "named"), the vectors between this and the next frame, and the vectors between
        this and the previous frame; None = missing.
    """
    for channels in _VECTOR:
        found = _group(image.planes, ("vector",), channels)
        if found is not None:
            return "blender", np.stack(found[2:], -1), np.stack(found[:2], -1)
    forth = next((f for pair in _BACK if (f := _group(image.planes, _FORTH_NAMES, pair))), None)
    back = next((f for pair in _BACK if (f := _group(image.planes, _BACK_NAMES, pair))), None)
    return "named", _stacked(forth), _stacked(back)


def _stacked(found: tuple[Plane, ...] | None) -> Flow | None:
    return None if found is None else np.stack(found, -1)


_SIGNS: Mapping[str, tuple[float, float, float]] = {
    "cycles": (-1.0, -1.0, -1.0),
    "eevee": (-1.0, 1.0, -1.0),
    "nuke": (1.0, -1.0, 1.0),
}
"""Sign factors of each convention: of the next-frame vectors (gives V+), of the previous-frame vectors (gives V-), and
of all y components."""


def signed(forth: Flow | None, back: Flow | None, factors: tuple[float, float, float]) -> Velocities:
    """Convert stored vectors to V+ and V- by sign factors; see `_SIGNS`."""
    axis = np.array([1.0, factors[2]], np.float32)

    def scaled(field: Flow | None, factor: float) -> Flow | None:
        return None if field is None else np.ascontiguousarray(field * (np.float32(factor) * axis), np.float32)

    return Velocities(scaled(forth, factors[0]), scaled(back, factors[1]))


def factors_of(
    convention: Convention, first: tuple[Exr, Frame], second: tuple[Exr, Frame]
) -> tuple[tuple[float, float, float], str]:
    """Sign factors of a convention, or those estimated from two frames, and a message for the job's log.

    Args:
        convention: "cycles" (XY = previous - current, ZW = current - next, y up), "eevee" (XY = current - previous),
            "nuke" (forward and backward vectors point to the pixel's position in the other frame; y as stored), or
            "auto" (the signs with the smallest warping error).
        first, second: EXR image and picture of two consecutive frames.

    Raises:
        BadInput: the convention is unknown, or the images have no motion vectors.
    """
    if convention in _SIGNS:
        return _SIGNS[convention], f"Motion vectors use the {convention} convention."
    if convention != "auto":
        raise BadInput("The vector convention is unknown.", field="vectors", value=convention,
                       remedy=f"Use one of: {', '.join(get_args(Convention))}.")  # fmt: skip
    _, forth, _ = raw_vectors(first[0])
    _, _, back = raw_vectors(second[0])
    if forth is None and back is None:
        raise BadInput("The EXR holds no motion vectors.", field="vectors", remedy="Render the Vector pass.")
    signs = (1.0, -1.0)
    tried = [(a, b, c) for a in signs for b in signs for c in signs]
    scores = {f: _misfit(signed(forth, back, f), first[1], second[1]) for f in tried}
    best = min(scores, key=lambda f: (scores[f], f))
    still = _misfit(Velocities(np.zeros((*first[1].shape[:2], 2), np.float32), None), first[1], second[1])
    message = (
        f"Signs of the motion vectors were estimated: V+ = {best[0]:+.0f} next, V- = {best[1]:+.0f} previous, "
        f"y {'as stored' if best[2] > 0 else 'negated'}; warping error {scores[best]:.2f} gray levels, {still:.2f} "
        "without vectors."
    )
    return best, message


def _misfit(velocities: Velocities, first: Frame, second: Frame) -> float:
    """Mean absolute difference between each frame and the other one warped along the vectors, gray levels."""
    total, count = 0.0, 0
    if velocities.plus is not None:
        total, count = total + _unlike(first, second, velocities.plus), count + 1
    if velocities.minus is not None:
        total, count = total + _unlike(second, first, -velocities.minus), count + 1
    return total / count if count else math.inf


def _unlike(here: Frame, there: Frame, way: Flow) -> float:
    height, width = way.shape[:2]
    y, x = np.mgrid[:height, :width].astype(np.float32)
    found = cv2.remap(there, x + way[..., 0], y + way[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return float(np.abs(found.astype(np.float32) - here).mean())


def write_exr(path: Path, planes: Planes, half: bool = False) -> None:
    """Write planes, by full channel name "pass.X", as a ZIP-compressed EXR in float32, or in float16 if `half`."""
    kind = np.float16 if half else np.float32
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {name: np.ascontiguousarray(plane, kind) for name, plane in planes.items()}) as file:
        file.write(str(path))

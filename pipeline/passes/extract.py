"""Passes of a sequence as numbered images: mattes and label maps as PNG, data in floating point, for other programs
and for the inputs of methods."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import cv2
import numpy as np

from pipeline.arrays import AnyArray
from pipeline.errors import BadParameter
from pipeline.formats import planes_format
from pipeline.formats.base import PlaneImage
from pipeline.passes.find import Where, depth, normals, position, uv
from pipeline.passes.sequence import PassSequence

_EPOCH = (1980, 1, 1, 0, 0, 0)
MATTE, IDS, MOTION = "matte", "ids", "motion"
_DATA: Mapping[str, tuple[Callable[[PlaneImage, Where], AnyArray | None], str]] = {
    "depth": (depth, "Z"), "normals": (normals, "XYZ"), "position": (position, "XYZ"), "uv": (uv, "UV"),
}  # fmt: skip
"""Name -> its reader, and the names of its channels in a file."""
NAMES = (MATTE, IDS, MOTION, *_DATA)


def extract(passes: PassSequence, wanted: str, path: Path) -> int:
    """Write a pass of every frame as a zip of images named by the numbers of the frames, whole or not at all.

    Returns the number of frames.

    Args:
        wanted: "matte:NAME" (16-bit PNG, white where the object is; several names joined by "+"), "ids" (label maps:
            PNG of 8 bits, or 16 for numbers above 255), "motion" (floating point, px, y down: forward to the next
            frame, backward to the previous one), or "depth", "normals", "position", "uv" (floating point, as rendered).

    Raises:
        BadParameter: another name, or the sequence does not have the pass.
    """
    kind, _, objects = wanted.partition(":")
    if kind not in NAMES or (kind == MATTE) != bool(objects):
        raise BadParameter("Unknown pass.", field="--extract", value=wanted,
                           remedy=f"Use matte:OBJECT, {', '.join(NAMES[1:])}.")  # fmt: skip
    names = objects.split("+") if objects else []
    part = path.with_name(f".{path.name}.part")
    try:
        with zipfile.ZipFile(part, "w", zipfile.ZIP_STORED) as archive:
            for number, (suffix, data) in zip(passes.numbers(), _images(passes, kind, names), strict=True):
                archive.writestr(zipfile.ZipInfo(f"{number:04d}{suffix}", _EPOCH), data)
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)
    return len(passes)


def _images(passes: PassSequence, kind: str, names: list[str]) -> Iterator[tuple[str, bytes]]:
    form = planes_format()
    suffix = form.suffixes[0]
    wide = kind == IDS and any((_labels(passes, index) > 255).any() for index in range(len(passes)))
    for index in range(len(passes)):
        if kind == MATTE:
            yield ".png", _png(np.rint(passes.matte(index, *names) * 65535).astype(np.uint16))
        elif kind == IDS:
            yield ".png", _png(_labels(passes, index).clip(0).astype(np.uint16 if wide else np.uint8))
        elif kind == MOTION:
            yield suffix, form.written(_motion(passes, index))
        else:
            read, channels = _DATA[kind]
            found = passes.data(index, read)
            if found is None:
                raise _missing(kind)
            planes = found[..., None] if found.ndim == 2 else found
            yield suffix, form.written({name: planes[..., k] for k, name in enumerate(channels)})


def _labels(passes: PassSequence, index: int) -> AnyArray:
    found = passes.labels(index)
    if found is None:
        raise _missing(IDS)
    return found


def _motion(passes: PassSequence, index: int) -> dict[str, AnyArray]:
    """V+ and V- of a frame as flows; those of the first and the last frame that have no neighbour are 0."""
    after = passes.motion(index) if index + 1 < len(passes) else None
    before = passes.motion(index - 1) if index else None
    known = after or before
    if known is None:
        raise _missing(MOTION)
    forth = after[0] if after else np.zeros_like(known[0])
    back = -before[1] if before else np.zeros_like(known[0])
    flows = {"forward": forth, "backward": back}
    return {f"{name}.{axis}": flow[..., k] for name, flow in flows.items() for k, axis in enumerate("uv")}


def _missing(kind: str) -> BadParameter:
    return BadParameter(f"The frames have no {kind}.", field="--extract", value=kind,
                        remedy="`impasto inspect` lists what they have.")  # fmt: skip


def _png(image: AnyArray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()

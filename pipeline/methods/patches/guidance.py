"""What the user says: masks and corrected label maps at keyframes, and a style for each patch."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import BadParameter
from pipeline.frames import Labels, Plane
from pipeline.methods.base import Bench
from pipeline.methods.patches.grid import Grid
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.styles import STYLES

MOST_LABELS = 65535


def keyframes(bench: Bench, name: str, frames: int) -> list[int]:
    """Numbers of the frames that the user has drawn on, ascending.

    Raises:
        BadParameter: a frame is beyond the video.
    """
    found = sorted(bench.images(name)) if bench.has(name) else []
    if found and found[-1] >= frames:
        raise BadParameter(
            "There is no such frame.", field=f"inputs.{name}[{found[-1]}]", value=found[-1],
            remedy=f"Frames of this video are 0 to {frames - 1}; an image's number is the last one in its name.",
        )  # fmt: skip
    return found


def check(bench: Bench, frames: int) -> None:
    """Look at all that the user says, before anything else is done.

    Raises:
        BadParameter: a map is on no frame, or of another shape, or has colours; or a style is none.
    """
    grid = Grid.of(bench.size)
    for name, read in (("labels", label_map), ("masks", mask_map)):
        images = bench.images(name) if bench.has(name) else {}
        for number in keyframes(bench, name, frames):
            read(images[number], grid, number)
    styles_of(bench)


def label_map(image: NDArray[Any], grid: Grid, number: int) -> Labels:
    """A corrected label map as int32 (h, w) at the working size: each gray value is a label, 0 = unclustered.

    Raises:
        BadParameter: it has colours, or another shape than the video.
    """
    field = f"inputs.labels[{number}]"
    if image.ndim == 3 and image.shape[2] >= 3 and (image[..., :3] == image[..., :1]).all():
        image = image[..., 0]
    if image.ndim != 2:
        raise BadParameter(
            "A label map has one number per pixel.", field=field, value=image.shape,
            remedy="Use a gray image of 8 or 16 bit, such as the artefact `labels` has.",
        )  # fmt: skip
    _check_shape(image, grid, field)
    small = cv2.resize(image.astype(np.float32), grid.size, interpolation=cv2.INTER_NEAREST)
    return np.rint(small).astype(np.int32)


def mask_map(image: NDArray[Any], grid: Grid, number: int) -> Plane:
    """A foreground mask as float32 (h, w) at the working size: 1 = foreground, 0 = background, NaN = not said.

    White and black are said; what lies between, or is transparent, is not: so scribbles are masks too.
    """
    field = f"inputs.masks[{number}]"
    top = np.float32(np.iinfo(image.dtype).max)
    gray = (image if image.ndim == 2 else image[..., :3].mean(axis=-1)) / top
    _check_shape(gray, grid, field)
    unsaid = (gray > 0.25) & (gray < 0.75)
    if image.ndim == 3 and image.shape[2] == 4:
        unsaid |= image[..., 3] < top / 2
    said = np.where(unsaid, np.nan, gray > 0.5).astype(np.float32)
    return np.asarray(cv2.resize(said, grid.size, interpolation=cv2.INTER_NEAREST), np.float32)


def _check_shape(image: NDArray[Any], grid: Grid, field: str) -> None:
    height, width = image.shape[:2]
    if abs(width * grid.height - height * grid.width) > max(grid.width, grid.height):
        raise BadParameter(
            "It has the shape of the video.", field=field, value=f"{width}x{height}",
            remedy=f"Use {grid.width}x{grid.height} px, or the same aspect ratio.",
        )  # fmt: skip


def styles_of(bench: Bench) -> Mapping[int, str]:
    """The style of each label that has one of its own, from the input "styles"; background is label 1.

    Raises:
        BadParameter: a key is no label, or a style is not known; the field is its JSON path.
    """
    if not bench.has("styles"):
        return {}
    given = bench.json("styles")
    if not isinstance(given, dict):
        raise BadParameter("Styles are an object: label -> style.", field="inputs.styles", value=type(given).__name__,
                           remedy='For example {"background": "wash", "3": "circles"}.')  # fmt: skip
    found = {}
    for key, style in given.items():
        if not isinstance(style, str) or style not in STYLES:
            raise BadParameter("There is no such style.", field=f"inputs.styles.{key}", value=style,
                               remedy=f"Use one of: {', '.join(STYLES)}.")  # fmt: skip
        number = 1 if key == "background" else int(key) if key.isdecimal() else 0
        if not 0 < number <= MOST_LABELS:
            raise BadParameter('A key is a label, or "background".', field=f"inputs.styles.{key}", value=key,
                               remedy="Labels are the gray values of the artefact `labels`, from 1.")  # fmt: skip
        found[number] = style
    return found


def style_of(label: int, params: PatchesParams, own: Mapping[int, str]) -> str:
    """The style of a patch: its own, else the background's, else everyone's."""
    if label in own:
        return own[label]
    if label == 1 and params.background_style != "same":
        return params.background_style
    return params.style

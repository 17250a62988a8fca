"""User inputs: masks and corrected label maps at keyframes, and styles of single patches."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.errors import BadParameter
from pipeline.frames import Labels, Plane
from pipeline.methods.base import TaskContext
from pipeline.methods.patches.grid import Grid
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.styles import STYLES

MOST_LABELS = 65535


def keyframes(context: TaskContext[PatchesParams], name: str, frames: int) -> list[int]:
    """Frame numbers of the images in input `name`, ascending.

    Raises:
        BadParameter: a frame is beyond the video.
    """
    found = sorted(context.images(name)) if context.has(name) else []
    if found and found[-1] >= frames:
        raise BadParameter(
            "There is no such frame.", field=f"inputs.{name}[{found[-1]}]", value=found[-1],
            remedy=f"Frames of this video are 0 to {frames - 1}; an image's number is the last one in its name.",
        )  # fmt: skip
    return found


def check(context: TaskContext[PatchesParams], frames: int) -> None:
    """Validate all user inputs before any other work.

    Raises:
        BadParameter: a map belongs to no frame of the video, has a wrong shape, or is not gray; or a style is unknown.
    """
    grid = Grid.of(context.size)
    for name, read in (("labels", label_map), ("masks", mask_map)):
        images = context.images(name) if context.has(name) else {}
        for number in keyframes(context, name, frames):
            read(images[number], grid, number)
    styles_of(context)


def label_map(image: NDArray[Any], grid: Grid, number: int) -> Labels:
    """Convert a corrected label map: int32 (h, w) at the working size. Gray values are labels, 0 = unclustered.

    Raises:
        BadParameter: the image is not gray, or has a different aspect ratio than the video.
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
    """Convert a foreground mask: float32 (h, w) at the working size, 1 = foreground, 0 = background, NaN = unknown.

    Gray (between 0.25 and 0.75) and transparent pixels are unknown, so that scribbles can be used as masks.
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


def styles_of(context: TaskContext[PatchesParams]) -> Mapping[int, str]:
    """Styles of single labels from the input "styles", by label; the key "background" is label 1.

    Raises:
        BadParameter: a key is not a label, or a style is unknown; `field` is the JSON path.
    """
    if not context.has("styles"):
        return {}
    given = context.json("styles")
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
    """Style of a patch: its own, else `background_style` for the background, else the general style."""
    if label in own:
        return own[label]
    if label == 1 and params.background_style != "same":
        return params.background_style
    return params.style

"""Inputs of the synthesis, independent of their origin: the inputs of a job, or a layer of a shot.

`SynthesisInputs` delivers, at full size: frames with extra guides, silhouettes and line distances; velocities, where
they are known; painted keyframes; a style pair.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.errors import BadInput
from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.masks import mask_plane
from pipeline.synthesis.images import Bytes, stacked

WHOLE = -1
"""Layer number of the whole picture."""
GUIDE_WEIGHT = 4.0
"""Default weight of a guide of a shot, per squared gray level."""
OPAQUE = 128
"""Opacity (8 bit) from which a pixel counts as painted."""
GLAZE = 26
"""The same where semi-transparent paint is a glaze over the frame: a tenth."""


@dataclass(frozen=True)
class Guide:
    """An extra guide.

    Attributes:
        weight: total weight of its channels, per squared gray level.
        channels: number of channels, 1 to 3.
    """

    name: str
    weight: float
    channels: int

    @property
    def weights(self) -> tuple[float, ...]:
        """Weight of each channel."""
        return (self.weight / self.channels,) * self.channels


@dataclass(frozen=True)
class InputFrame:
    """One frame of the video with everything that guides its synthesis, at full size.

    Attributes:
        frame: uint8 (h, w, 3).
        guides: extra guides, uint8 (h, w, channels), in the order of `SynthesisInputs.guides`; None = no guides.
        line_distance: float32 (h, w), distance to the nearest line, px; None = no lines.
        paintable: bool (h, w), pixels that may be painted; None = all pixels.
        silhouette: bool (h, w), pixels of the layer; None = everywhere.
        directions: float32 (h, w, 3), given directions, see `authored_tensors`; None = computed.
    """

    frame: Frame
    guides: Bytes | None = None
    line_distance: Plane | None = None
    paintable: Mask | None = None
    silhouette: Mask | None = None
    directions: Plane | None = None


@dataclass(frozen=True)
class StylePair:
    """Style input S and style output S^.

    Attributes:
        output: S^, uint8 (h, w, 3), or (h, w, 4) with opacity.
        guide: S in CIELAB, uint8 (h, w, 3).
        derived: whether S was derived from S^.
        extra_guides: uint8 (h, w, n); None = no extra guides.
        usable: uint8 (h, w), 0 = the pixel must not be used; None = all pixels may be used.
        line_distance: float32 (h, w), distance to the lines of the style, px; None = no lines.
        directions: float32 (h, w, 3), given directions, see `authored_tensors`; None = computed.
    """

    output: Bytes
    guide: Bytes
    derived: bool
    extra_guides: Bytes | None = None
    usable: Bytes | None = None
    line_distance: Plane | None = None
    directions: Plane | None = None

    @property
    def guides(self) -> Bytes:
        """S and the extra guides, uint8 (h, w, 3 + n)."""
        return self.guide if self.extra_guides is None else stacked([self.guide, self.extra_guides])


@dataclass(frozen=True)
class Keyframe:
    """A painted frame of the video.

    Attributes:
        index: frame number.
        colours: uint8 (h, w, 3), or (h, w, 4) with opacity for a keyframe of a layer.
        painted: uint8 (h, w), 0 = not painted; None = painted everywhere.
    """

    index: int
    colours: Bytes
    painted: Bytes | None

    @property
    def full(self) -> bool:
        """Whether the frame is painted everywhere."""
        return self.painted is None


class SynthesisInputs(Protocol):
    """Inputs of one picture: the whole frame (`layer` = -1) or one layer of a shot."""

    layer: int
    params: AnalogyParams

    @property
    def guides(self) -> tuple[Guide, ...]:
        """Extra guides with a weight above 0."""
        ...

    @property
    def rotates(self) -> bool:
        """Whether patches rotate by the difference of the directions of style and frame."""
        ...

    @property
    def statistics_artefact(self) -> str:
        """Name of the artefact with the `LayerStatistics` of these inputs, saved by the step `scan`."""
        ...

    def frames(self, start: int, stop: int) -> Iterator[InputFrame]:
        """Frames [start, stop), fewer if the video ends before."""
        ...

    def velocities(self, first: int) -> tuple[Flow, Flow] | None:
        """V+ of frame `first` and V- of the next frame, px at full size; None = estimate them by optical flow."""
        ...

    def keyframe_numbers(self) -> tuple[int, ...]:
        """Frame numbers of the keyframes."""
        ...

    def keyframe(self, index: int) -> Keyframe:
        """The keyframe of frame `index`.

        Raises:
            BadInput: its size differs from the video's, or no pixel is painted.
        """
        ...

    def style_pair(self) -> StylePair:
        """The given style pair, or the default pair."""
        ...

    def has_style_pair(self) -> bool:
        """Whether a style pair is given."""
        ...

    @property
    def painting_alone(self) -> bool:
        """Whether the given style is only a painting, without a registered input, guides or lines."""
        ...


def id_colours(ids: np.ndarray[tuple[int, ...], np.dtype[np.integer]]) -> Bytes:
    """Object numbers as well separated colours, uint8 (h, w, 3): bit k becomes a high bit of channel k % 3."""
    low = ids.astype(np.int64) & 0xFF ^ (ids.astype(np.int64) >> 8 & 0xFF)
    out = np.zeros((*ids.shape, 3), np.uint8)
    for bit in range(8):
        out[..., bit % 3] |= ((low >> bit & 1) << (7 - bit // 3)).astype(np.uint8)
    return out


def painted_masks(inputs: SynthesisInputs, frames: int) -> dict[int, Mask | None]:
    """Painted pixels of each keyframe by frame number, see `Keyframe.painted`, reduced to at most `_MASK_PX` px a side.

    Args:
        frames: number of frames of the video.

    Raises:
        BadInput: the frame does not exist, or the keyframe has a wrong size or no painted pixel.
    """
    found: dict[int, Mask | None] = {}
    for index in inputs.keyframe_numbers():
        if index >= frames:
            raise BadInput(
                f"Keyframe {index} has no frame: the video has frames 0 to {frames - 1}.",
                field="inputs.keyframes", value=index,
                remedy=f"Name keyframes by frame numbers, 0 to {frames - 1}.",
            )  # fmt: skip
        painted = inputs.keyframe(index).painted
        step = 1 if painted is None else -(-max(painted.shape) // _MASK_PX)
        found[index] = None if painted is None else painted[::step, ::step] > 0
    return found


_MASK_PX = 256


def key_sources(masks: Mapping[int, Mask | None]) -> dict[int, tuple[list[int], list[int]]]:
    """The keyframes that paint the pixels at each keyframe: the last ones up to it, and the first ones from it on.

    A keyframe that is painted everywhere needs no other. In a partial one, each unpainted pixel has the last keyframe
    that painted it. Positions are compared without motion.

    Args:
        masks: painted pixels of the keyframes of a shot by frame number, ascending; None = everywhere.

    Returns:
        Frame number -> both lists: the keyframe itself, then others by the number of pixels that they paint.
    """
    partial = next((mask for mask in masks.values() if mask is not None), None)
    if partial is None:
        return {index: ([index], [index]) for index in masks}
    behind, ahead = (_latest(masks, partial.shape, numbers) for numbers in (list(masks), list(masks)[::-1]))
    return {index: (behind[index], ahead[index]) for index in masks}


def _latest(masks: Mapping[int, Mask | None], shape: tuple[int, ...], numbers: Sequence[int]) -> dict[int, list[int]]:
    """For each keyframe, in this order: the keyframes up to it whose pixels no later one paints over."""
    latest, found = np.full(shape, -1), dict[int, list[int]]()
    for index in numbers:
        mask = masks[index]
        latest[slice(None) if mask is None else mask] = index
        names, counts = np.unique(latest[latest >= 0], return_counts=True)
        by_area = sorted(zip(-counts, names, strict=True))
        found[index] = [index, *(int(name) for _, name in by_area if name != index)]
    return found


def read_keyframe(
    index: int, image: AnyArray, size: tuple[int, int], mask: AnyArray | None, field: str,
    under: Callable[[], Frame] | None = None,
) -> Keyframe:  # fmt: skip
    """Check and convert a keyframe.

    Args:
        image: uint8 or uint16; gray, RGB or RGBA. Alpha marks the painted pixels.
        size: (width, height) of the video, px.
        mask: uint8 or uint16; replaces alpha. None = no mask.
        field: name of the input, for error texts.
        under: returns the frame, uint8 (h, w, 3), over which semi-transparent paint is a glaze; None = paint counts as
            opaque from half opacity on.

    Raises:
        BadInput: the size differs from the video's, or no pixel is painted.
    """
    if (image.shape[1], image.shape[0]) != size:
        raise BadInput(
            f"Keyframe {index} does not have the size of the video.", field=field,
            value=f"{image.shape[1]}x{image.shape[0]}",
            remedy=f"Paint over frame {index} at {size[0]}x{size[1]}.",
        )  # fmt: skip
    pixels = eight_bit(image)
    colours = np.repeat(pixels[..., None], 3, axis=2) if pixels.ndim == 2 else pixels[..., :3]
    alpha = pixels[..., 3] if pixels.ndim == 3 and pixels.shape[2] == 4 else None
    if mask is not None:
        alpha = _key_mask(index, mask, size)
    least = OPAQUE if under is None else GLAZE
    if under is not None and alpha is not None:
        opacity = alpha[..., None].astype(np.float32) / np.float32(255)
        below = under().astype(np.float32)
        colours = np.rint(below + opacity * (colours - below)).astype(np.uint8)
    painted = None if alpha is None or (alpha >= least).all() else (alpha >= least).astype(np.uint8)
    if painted is not None and not painted.any():
        raise BadInput(
            f"Keyframe {index} has no painted pixel: it is completely transparent.", field=field,
            remedy="Paint on it, or remove it.",
        )  # fmt: skip
    return Keyframe(index, np.ascontiguousarray(colours), painted)


def eight_bit(image: AnyArray) -> Bytes:
    """Convert 16 bits or float32 0..1 per channel to 8 bits; 8-bit images are returned unchanged."""
    if image.dtype == np.uint8:
        return np.asarray(image, np.uint8)
    return np.asarray(image >> 8 if image.dtype == np.uint16 else np.rint(image.clip(0, 1) * 255), np.uint8)


def _key_mask(index: int, mask: AnyArray, size: tuple[int, int]) -> Bytes:
    if (mask.shape[1], mask.shape[0]) != size:
        raise BadInput(
            f"Mask {index} does not have the size of the video.", field="inputs.masks",
            value=f"{mask.shape[1]}x{mask.shape[0]}", remedy=f"Make it {size[0]}x{size[1]}.",
        )  # fmt: skip
    return np.asarray(np.rint(mask_plane(mask) * 255), np.uint8)

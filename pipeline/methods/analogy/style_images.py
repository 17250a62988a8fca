"""Style images: the default style pair, keyframes as style, and the style at every level of the pyramid."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from pipeline.errors import BadInput
from pipeline.frames import Frame, Plane
from pipeline.methods.analogy.inputs import Guide, Keyframe, StylePair, SynthesisInputs
from pipeline.methods.analogy.key_intervals import KeyInterval
from pipeline.methods.analogy.level_animation import LevelFrames, direction_bins_of
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.base import TaskContext
from pipeline.strokes.brush import Brush
from pipeline.strokes.emboss import emboss
from pipeline.strokes.layers import StillPainting, paint_still
from pipeline.synthesis.atlas import Atlas, AtlasImage, atlas
from pipeline.synthesis.energy import Energy
from pipeline.synthesis.images import Bytes, Offsets, StyleImage, halved, packed
from pipeline.synthesis.orientation import DirectionSources
from pipeline.tensors.structure import structure_tensor, tangent_field
from pipeline.video.contact_sheet import fit

MAX_CHANNELS = 32
"""Maximum number of bytes of a pixel that patches compare: colours, CIELAB, and 25 or more channels of guides."""
KEPT_COST = 0.9
"""Factor on the cost of the advected offset at the finest level. At coarser levels it approaches 1, and the weight of
the temporal term approaches 0."""


def energy_of(
    params: AnalogyParams,
    guides: tuple[Guide, ...],
    level: int,
    *,
    colours: int = 3,
    keyframe_style: bool = False,
    subpixel: bool = False,
) -> Energy:
    """The energy function of a parameter set at a level; lengths in px shrink with the level.

    Args:
        guides: extra guides.
        colours: number of channels of the output, 3 or 4.
        keyframe_style: whether the keyframes are the style.
        subpixel: whether strokes move by fractions of a pixel. If so, advected offsets are preferred. With copied
            pixels, this preference would raise flicker.

    Raises:
        BadInput: colours and guides together have more than `MAX_CHANNELS` channels.
    """
    weight = params.key_guide_weight if keyframe_style else params.guide_weight
    hue = weight * (params.key_colour_weight if keyframe_style else params.colour_weight) / 2
    extra = tuple(w for guide in guides for w in guide.weights)
    if colours + 3 + len(extra) > MAX_CHANNELS:
        names = ", ".join(f"{guide.name} {guide.channels}" for guide in guides)
        raise BadInput(
            "There are too many guides.", field="guides", value=f"channels: {names}",
            remedy=f"Use at most {MAX_CHANNELS - 3 - colours} channels: make some guides gray, or remove some.",
        )  # fmt: skip
    half = 2.0**-level
    return Energy(
        colours=colours, radius=params.patch_radius, sigma_px=params.patch_sigma, w_out=params.texture_weight,
        guides=(weight, hue, hue, *extra),
        w_sc=params.coherence_weight, r_max_px2=params.coherence_limit,
        w_tc=0.0 if keyframe_style or params.temporal == "off" else params.steadiness * params.coarse_steadiness**level,
        kept_cost=1.0 - (1.0 - KEPT_COST) * params.coarse_steadiness**level if subpixel else 1.0,
        w_h=params.variety_weight, h_limit=params.variety_limit,
        w_dt=params.lines_weight / half**2, d_max_px=params.lines_reach * half,
        w_din=params.change_weight if keyframe_style else 0.0,
        w_dout=params.change_out_weight if keyframe_style else 0.0,
    )  # fmt: skip


class StylePyramid:
    """A style pair at every level; levels are computed on first use.

    Args:
        rotates: whether patches rotate, which needs the directions of the style.
    """

    def __init__(self, pair: StylePair, params: AnalogyParams, rotates: bool) -> None:
        self._pairs = [pair]
        self._params, self._rotates = params, rotates

    def at(self, level: int, energy: Energy) -> StyleImage:
        """The style at a level, packed for an energy function."""
        while len(self._pairs) <= level:
            self._pairs.append(_halved_pair(self._pairs[-1]))
        pair = self._pairs[level]
        bins = self._directions(pair, level) if self._rotates else None
        features = packed(energy, patch_colours(pair.output, self._params.colours), pair.guides)
        return StyleImage(pair.output, features, bins, pair.usable, pair.line_distance)

    def _directions(self, pair: StylePair, level: int) -> Bytes:
        sources = DirectionSources(np.ascontiguousarray(pair.guide[..., 0]), pair.line_distance, pair.directions)
        return direction_bins_of(sources, self._params, level)


def patch_colours(output: Bytes, space: str) -> Bytes:
    """The colours that patches compare: uint8 (h, w, 3 or 4).

    They are premultiplied by opacity, since transparent pixels have no meaningful colour.

    Args:
        space: "rgb" or "lab" (CIELAB).
    """
    colours = np.ascontiguousarray(output[..., :3])
    if space == "lab":
        colours = np.asarray(cv2.cvtColor(colours, cv2.COLOR_RGB2Lab), np.uint8)
    if output.shape[2] == 3:
        return colours
    opacity = output[..., 3:].astype(np.uint16)
    return np.concatenate([((colours * opacity + 127) // 255).astype(np.uint8), output[..., 3:]], axis=-1)


def _halved_pair(pair: StylePair) -> StylePair:
    def bytes_of(image: Bytes) -> Bytes:
        return np.asarray(halved(image), np.uint8)

    return StylePair(
        bytes_of(pair.output), bytes_of(pair.guide), pair.derived,
        None if pair.extra_guides is None else bytes_of(pair.extra_guides),
        None if pair.usable is None else np.asarray(halved(pair.usable, nearest=True), np.uint8),
        None if pair.line_distance is None else np.asarray(halved(pair.line_distance), np.float32) / np.float32(2),
        None if pair.directions is None else np.asarray(halved(pair.directions), np.float32),
    )  # fmt: skip


# -- default style pair

DEFAULT_PAIR = "own"
"""Name of the artefact with the default style pair, which the step `scan` saves."""
_DEFAULT_PAIR_PX = 960
"""Maximum length of its longer side, px."""
_BRUSH = Brush(size_px=9, length_px=34, jitter=0.35, relief_px=1.0, grain=0.5)
"""Strokes for a picture 320 px high; their sizes grow with the height."""


def save_default_pair(context: TaskContext[AnalogyParams], frames: int) -> None:
    """Paint the middle frame of a video in short strokes, and save both pictures as an artefact.

    Such a style contains every tone and hue of the video. It is used when the job has no painting.

    Args:
        frames: number of frames of the video.
    """
    plain = fit(next(context.frames("video", frames // 2, frames // 2 + 1)), _DEFAULT_PAIR_PX)
    context.save(DEFAULT_PAIR, {"plain": plain, "painting": paint_in_strokes(plain)})


def default_pair(context: TaskContext[AnalogyParams]) -> tuple[Frame, Frame]:
    """Load (S, S^) as saved by `save_default_pair`: uint8 (h, w, 3), at most 960 px on the longer side."""
    saved = context.load("scan", DEFAULT_PAIR)
    return np.asarray(saved["plain"], np.uint8), np.asarray(saved["painting"], np.uint8)


def paint_in_strokes(plain: Frame) -> Frame:
    """Paint a picture in short embossed strokes of its own colours. Deterministic; uint8 (h, w, 3)."""
    gray = cv2.cvtColor(plain, cv2.COLOR_RGB2GRAY).astype(np.float32)
    tangents = tangent_field(structure_tensor(gray, 6.0), 0.0)
    doubled = np.stack([tangents[..., 0] ** 2 - tangents[..., 1] ** 2, 2 * tangents[..., 0] * tangents[..., 1]], -1)
    field = np.where((tangents == 0).all(-1, keepdims=True), np.array([1, 0], np.float32), doubled).astype(np.float32)
    scale = max(1.0, plain.shape[0] / 320)
    brush = replace(_BRUSH, size_px=_BRUSH.size_px * scale, length_px=_BRUSH.length_px * scale)
    return emboss(paint_still(plain, field, StillPainting(brush, threshold=24.0)))


# -- keyframes as style

FURTHER = -1
"""Name of the style pair that is used in addition to the keyframes of an interval."""
NO_LINE_DISTANCE_PX = 1e4
"""Distance to the lines of a style that has none, px."""


@dataclass(frozen=True)
class KeyframeStyle:
    """The keyframes of an interval as one style image.

    Attributes:
        pair: the keyframes, and the frames that they were painted over.
        painted: frame number -> offsets that reproduce the keyframe, float32 (h, w, 2).
        images: the images by the keyframe's number; `FURTHER` = the pair that is used in addition.
    """

    pair: StylePair
    painted: dict[int, Offsets]
    images: dict[int, AtlasImage]


def keyframe_style(
    context: TaskContext[AnalogyParams],
    inputs: SynthesisInputs,
    interval: KeyInterval,
    frames: LevelFrames,
    levels: int,
    pad_px: int,
    further: StylePair | None,
) -> KeyframeStyle:
    """Pack the keyframes of an interval into one style image (section 4 of benard2013stylizing).

    Args:
        frames: the frames of the interval at full size.
        levels: number of levels of the pyramid.
        pad_px: maximum distance of a tap of a patch from its centre, px; see `Energy.pad`.
        further: a style pair that is used in addition; None = keyframes only.
    """
    keys = [inputs.keyframe(index) for index in interval.keys]
    pairs = [_keyframe_pair(context, frames, key) for key in keys] + ([further] if further else [])
    layout = atlas([(pair.output.shape[1], pair.output.shape[0]) for pair in pairs], levels, 2 * pad_px)
    usable = layout.usable([pair.usable for pair in pairs])
    colours = np.asarray(layout.compose([pair.output for pair in pairs]), np.uint8)
    guide = np.asarray(layout.compose([pair.guide for pair in pairs]), np.uint8)
    extra_guides = None
    if pairs[0].extra_guides is not None:
        planes = [pair.extra_guides for pair in pairs if pair.extra_guides is not None]
        extra_guides = np.asarray(layout.compose(planes), np.uint8)
    lines = _composed(layout, [pair.line_distance for pair in pairs], NO_LINE_DISTANCE_PX)
    directions = _composed(layout, [pair.directions for pair in pairs], 0.0)
    pair = StylePair(colours, guide, False, extra_guides, usable, lines, directions)
    painted = {
        key.index: layout.identity(number, key.painted)
        for number, key in enumerate(keys)
        if interval.start <= key.index < interval.stop
    }
    names = [key.index for key in keys] + ([FURTHER] if further else [])
    return KeyframeStyle(pair, painted, dict(zip(names, layout.images, strict=True)))


def _keyframe_pair(context: TaskContext[AnalogyParams], frames: LevelFrames, key: Keyframe) -> StylePair:
    """A keyframe as a style pair with the frame that it was painted over, which is among `frames` or is read."""
    if key.index not in frames.frames:
        frames = LevelFrames(frames.inputs, context.clock, key.index, key.index + 1, 0)
    guides = frames.guides[key.index]
    extra_guides = np.ascontiguousarray(guides[..., 3:]) if guides.shape[2] > 3 else None
    lines = frames.line_distances.get(key.index)
    directions = frames.directions.get(key.index)
    return StylePair(
        key.colours, np.ascontiguousarray(guides[..., :3]), False, extra_guides, key.painted, lines, directions
    )  # fmt: skip


def _composed(layout: Atlas, planes: list[Plane | None], missing: float) -> Plane | None:
    """The atlas of a float plane of each image; images without it get the value `missing`. None = no image has it."""
    given = next((plane for plane in planes if plane is not None), None)
    if given is None:
        return None
    filled = [
        np.full((image.height, image.width, *given.shape[2:]), missing, np.float32) if plane is None else plane
        for plane, image in zip(planes, layout.images, strict=True)
    ]
    return np.asarray(layout.compose(filled), np.float32)

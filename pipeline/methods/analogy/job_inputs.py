"""Inputs of a job without layers: video, style pair, guides a to c, lines, painted keyframes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cached_property, partial

import cv2
import numpy as np

from pipeline.arrays import AnyArray
from pipeline.compute import device
from pipeline.errors import BadInput
from pipeline.formats import has_planes
from pipeline.frames import Flow, Frame, Plane
from pipeline.methods.analogy.automatic_guides import automatic_guides, automatic_planes
from pipeline.methods.analogy.data_images import UNIT, Range, data_picture, direction_data, range_of, read_data
from pipeline.methods.analogy.inputs import WHOLE, Guide, InputFrame, Keyframe, StylePair, read_keyframe
from pipeline.methods.analogy.key_settings import Settings, key_settings, reaching
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.shot_layers import LayerStatistics
from pipeline.methods.analogy.style_images import default_pair
from pipeline.methods.base import TaskContext
from pipeline.synthesis.distance import distance
from pipeline.synthesis.images import Bytes, stacked
from pipeline.synthesis.orientation import authored_tensors
from pipeline.synthesis.tone_matching import derived_guide, lab_guide, smoothed

GUIDES = ("a", "b", "c")
MAX_PAINTING_PX = 16000
"""Maximum length of a side of the painting, px."""
LINE_GRAY = 128
"""Gray level below which a pixel of a line drawing belongs to a line."""
GRAY_TOLERANCE = 8
"""Maximum channel difference of a gray picture, gray levels: video codecs tint gray slightly."""


class JobInputs:
    """`SynthesisInputs` of a job without layers.

    Args:
        keyframe_style: whether the keyframes are the style.
        statistics: results of the step `scan`; None during the scan.
    """

    layer = WHOLE
    statistics_artefact = "tones"
    near: int | None = None
    """A frame of a shot without keyframes: its style is the nearest keyframe of the job, unless a painting is given."""

    def __init__(
        self, context: TaskContext[AnalogyParams], keyframe_style: bool = False,
        statistics: LayerStatistics | None = None,
    ) -> None:  # fmt: skip
        self.params: AnalogyParams = context.params
        self._context, self._keyframe_style, self._statistics = context, keyframe_style, statistics

    # -- frames

    @cached_property
    def guides(self) -> tuple[Guide, ...]:
        return (*self._given_guides, *automatic_guides(self.params))

    @cached_property
    def _given_guides(self) -> tuple[Guide, ...]:
        weights = {name: getattr(self.params, f"guide_{name}_weight") for name in GUIDES}
        return tuple(Guide(name, weights[name], self._channels(name)) for name in GUIDES if self._has(name))

    def _has(self, name: str) -> bool:
        return self._context.has(f"guide_{name}")

    def _channels(self, name: str) -> int:
        """Channels of a guide: 1 if its style counterpart (or, without one, its first frame) is gray, else 3."""
        field = f"style_guide_{name}"
        return 1 if is_gray(self._data_image(field if self._context.has(field) else f"guide_{name}")) else 3

    # -- inputs that are data

    def _data_files(self, name: str) -> tuple[Mapping[str, bytes], tuple[str, ...]]:
        """The files of an input, and the paths of its images in order if they have planes."""
        files = self._context.entries(name)
        return files, tuple(files) if all(map(has_planes, files)) else ()

    def _data_frames(self, name: str, start: int, stop: int) -> Iterator[Frame]:
        """Frames of a guide or of `lines`, uint8 (h, w, 3); see `data_images`."""
        files, paths = self._data_files(name)
        if not paths:
            return self._context.frames(name, start, stop)
        return (data_picture(read_data(files, path), self._range(name)) for path in paths[start:stop])

    def _data_image(self, name: str) -> Frame:
        """The style's counterpart of a guide or of `lines`, uint8 (h, w, 3); see `data_images`."""
        files, paths = self._data_files(name)
        data = read_data(files, paths[0]) if paths else self._context.image(name)
        return data_picture(data, self._range(name.removeprefix("style_")))

    def _range(self, name: str) -> Range:
        return UNIT if self._statistics is None else self._statistics.ranges.get(name, UNIT)

    def ranges(self) -> dict[str, Range]:
        """Ranges of the guides that have values outside 0..1, in all frames and in the style."""
        found = {}
        for guide in (f"guide_{name}" for name in GUIDES if self._has(name)):
            inputs = (name for name in (guide, f"style_{guide}") if self._context.has(name))
            files = [self._data_files(name) for name in inputs]
            found[guide] = range_of(read_data(images, path) for images, paths in files for path in paths)
        return {name: limits for name, limits in found.items() if limits != UNIT}

    def _direction_frames(self, start: int, stop: int) -> Iterator[AnyArray]:
        files, paths = self._data_files("directions")
        if not paths:
            return self._context.frames("directions", start, stop)
        return (direction_data(files, path) for path in paths[start:stop])

    @cached_property
    def has_lines(self) -> bool:
        """Whether the job draws lines. With keyframes as style, the lines of their frames are the lines of the style.

        Raises:
            BadInput: only one of `lines` and `style_lines` is given.
        """
        given = {name for name in ("lines", "style_lines") if self._context.has(name)}
        keyed = self._keyframe_style or self.nearest_key() is not None
        if len(given) == 1 and not (keyed and "lines" in given):
            missing = ({"lines", "style_lines"} - given).pop()
            raise BadInput(
                "Lines need two inputs: lines and style_lines.", field=f"inputs.{missing}",
                remedy=f"Give {missing}: black lines on white.",
            )  # fmt: skip
        return bool(given) and self.params.lines_weight > 0

    @property
    def rotates(self) -> bool:
        given = self._context.has("directions") or self._context.has("style_directions")
        return given if self.params.rotation == "auto" else self.params.rotation == "on"

    @property
    def _has_directions(self) -> bool:
        return self.rotates and self._context.has("directions")

    def frames(self, start: int, stop: int) -> Iterator[InputFrame]:
        guides = {guide: self._data_frames(f"guide_{guide.name}", start, stop) for guide in self._given_guides}
        drawings = self._data_frames("lines", start, stop) if self.has_lines else None
        directions = self._direction_frames(start, stop) if self._has_directions else None
        for frame in self._context.frames("video", start, stop):
            planes = [
                guide_plane(_next(pictures, f"guide_{guide.name}", frame), guide.channels)
                for guide, pictures in guides.items()
            ] + automatic_planes(automatic_guides(self.params), frame)
            distance_px = None if drawings is None else line_distance(_next(drawings, "lines", frame))
            tensors = None if directions is None else authored_tensors(_next(directions, "directions", frame))
            yield InputFrame(frame, stacked(planes) if planes else None, distance_px, directions=tensors)

    def velocities(self, first: int) -> tuple[Flow, Flow] | None:
        return None

    # -- keyframes

    def keyframe_numbers(self) -> tuple[int, ...]:
        return tuple(self._context.images("keyframes")) if self._context.has("keyframes") else ()

    def keyframe(self, index: int) -> Keyframe:
        masks = self._context.images("masks") if self._context.has("masks") else {}
        image = self._context.images("keyframes")[index]
        under = partial(self._frame, index) if self.params.key_transparency == "glaze" else None
        return read_keyframe(index, image, self._context.size, masks.get(index), "inputs.keyframes", under)

    def _frame(self, index: int) -> Frame:
        return next(self._context.frames("video", index, index + 1))

    @cached_property
    def key_settings(self) -> Settings:
        """Reach and weight of the keyframes."""
        has = self._context.has("keyframe_settings")
        return key_settings(self._context.json("keyframe_settings")) if has else {}

    def nearest_key(self) -> int | None:
        """The keyframe that is the style of frames without one, which it reaches; None: the style is another."""
        if self.near is None or self.has_style_pair():
            return None
        return next(iter(reaching(self.near, self.keyframe_numbers(), self.key_settings)), None)

    def _key_pair(self, index: int) -> StylePair:
        """A keyframe and the frame that it was painted over, with its guides, lines and directions."""
        key, seen = self.keyframe(index), next(self.frames(index, index + 1))
        extra = seen.guides if self.guides else None
        guide = lab_guide(seen.frame)
        return StylePair(key.colours, guide, False, extra, key.painted, seen.line_distance, seen.directions)

    # -- the style

    def has_style_pair(self) -> bool:
        return self._context.has("style_output")

    @property
    def painting_alone(self) -> bool:
        registered = ("style", "style_lines", "style_directions", *(f"style_guide_{name}" for name in GUIDES))
        return self.has_style_pair() and not any(self._context.has(name) for name in registered)

    def style_pair(self) -> StylePair:
        """The given style pair, or the default pair.

        Raises:
            BadInput: a style input without output, different sizes, or a guide without style counterpart.
        """
        context = self._context
        if not context.has("style_output"):
            if context.has("style"):
                raise BadInput(
                    "The input style needs style_output, the painting of it.", field="inputs.style_output",
                    remedy="Give style_output too, or give the painting alone as style_output.",
                )  # fmt: skip
            if (key := self.nearest_key()) is not None:
                return self._key_pair(key)
            plain, painting = default_pair(context)
            guides, lines = self._style_guides(painting, plain), self._style_lines(painting)
            pair = StylePair(painting, lab_guide(plain), True, guides, None, lines)
            return replace(pair, directions=self._style_directions(painting))
        painting = context.image("style_output")
        check_painting_size(painting, "inputs.style_output")
        plain_picture = same_size(context.image("style"), painting, "inputs.style") if context.has("style") else None
        scene = smoothed(painting, self.params.style_smoothing) if plain_picture is None else plain_picture
        guides, lines = self._style_guides(painting, scene), self._style_lines(painting)
        pair = make_style_pair(painting, plain_picture, self.params.style_smoothing, guides, lines)
        return replace(pair, directions=self._style_directions(painting))

    def _style_directions(self, painting: Frame) -> Plane | None:
        if not self.rotates or not self._context.has("style_directions"):
            return None
        files, paths = self._data_files("style_directions")
        given = direction_data(files, paths[0]) if paths else self._context.image("style_directions")
        return authored_tensors(same_size(given, painting, "inputs.style_directions"))

    def _style_lines(self, painting: Frame) -> Plane | None:
        if not self.has_lines or not self._context.has("style_lines"):
            return None
        return line_distance(same_size(self._data_image("style_lines"), painting, "inputs.style_lines"))

    def _style_guides(self, painting: Frame, scene: Frame) -> Bytes | None:
        """Style counterparts of the guides, uint8 (h, w, n); those that are computed, of the painting's scene."""
        planes = []
        for guide in self._given_guides:
            field = f"style_guide_{guide.name}"
            if not self._context.has(field):
                raise BadInput(
                    f"The guide {guide.name} has no counterpart in the style.", field=f"inputs.{field}",
                    remedy=f"Give {field}, of the painting's size, or leave guide_{guide.name} out.",
                )  # fmt: skip
            picture = same_size(self._data_image(field), painting, f"inputs.{field}")
            planes.append(guide_plane(picture, guide.channels))
        planes += automatic_planes(automatic_guides(self.params), scene)
        return stacked(planes) if planes else None


def make_style_pair(
    painting: Bytes, plain: Frame | None, smoothing_px: float, guides: Bytes | None, line_distance: Plane | None
) -> StylePair:
    """A style pair from a painting and the plain picture that it shows.

    Args:
        painting: uint8 (h, w, 3), or (h, w, 4) with opacity.
        plain: uint8 (h, w, 3); None = S is derived from the painting.
        smoothing_px: smoothing of the derived S, px.
        guides: extra guides, uint8 (h, w, n); None = no extra guides.
        line_distance: float32 (h, w), distance to the lines of the painting, px; None = no lines.
    """
    opaque = np.ascontiguousarray(painting[..., :3])
    guide = derived_guide(opaque, smoothing_px) if plain is None else lab_guide(plain)
    return StylePair(painting, guide, plain is None, guides, None, line_distance)


def check_painting_size(painting: Bytes, field: str) -> None:
    """Raise `BadInput` if the painting exceeds `MAX_PAINTING_PX`."""
    if max(painting.shape[:2]) > MAX_PAINTING_PX:
        raise BadInput(
            "The painting is too large.", field=field, value=f"{painting.shape[1]}x{painting.shape[0]}",
            remedy=f"At most {MAX_PAINTING_PX} px per side.",
        )  # fmt: skip


def is_gray(picture: Frame) -> bool:
    """Whether all channels of a picture are equal within `GRAY_TOLERANCE`."""
    levels = picture.astype(np.int16)
    return int(np.abs(levels - levels[..., :1]).max()) <= GRAY_TOLERANCE


def guide_plane(picture: Frame, channels: int) -> Bytes:
    """A guide picture with 1 channel (converted to gray) or 3 (unchanged)."""
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), np.uint8) if channels == 1 else picture


def line_distance(picture: Frame) -> Plane:
    """Distance to the nearest dark pixel (gray < `LINE_GRAY`) of a line drawing, px, float32 (h, w)."""
    return distance(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) < LINE_GRAY, device())


def same_size(image: AnyArray, painting: Bytes, field: str) -> AnyArray:
    """Return `image` unchanged.

    Raises:
        BadInput: its size differs from the painting's.
    """
    if image.shape[:2] != painting.shape[:2]:
        raise BadInput(
            "The picture must have the size of the painting.", field=field, value=f"{image.shape[1]}x{image.shape[0]}",
            remedy=f"Scale it to {painting.shape[1]}x{painting.shape[0]}, registered with the painting.",
        )  # fmt: skip
    return image


def _next(frames: Iterator[AnyArray], name: str, frame: Frame) -> AnyArray:
    """The next frame of an input that accompanies the video.

    Raises:
        BadInput: the input has fewer frames than the video, or another size.
    """
    found = next(frames, None)
    if found is None or found.shape[:2] != frame.shape[:2]:
        problem = "ends before the video" if found is None else f"is {found.shape[1]}x{found.shape[0]}"
        raise BadInput(
            f"The input {name} {problem}.", field=f"inputs.{name}",
            remedy=f"Give as many frames of {frame.shape[1]}x{frame.shape[0]} as the video has.",
        )  # fmt: skip
    return found

"""The job's own inputs as a source: a video, a style pair, guides a to c, lines, painted keyframes."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import cv2
import numpy as np

from pipeline.compute import device
from pipeline.errors import BadInput
from pipeline.frames import Flow, Frame, Plane
from pipeline.methods.analogy.exemplar import own_pair
from pipeline.methods.analogy.keys import Key, read_key
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.sources import WHOLE, Guide, Pair, Picture
from pipeline.methods.base import Bench
from pipeline.synthesis.distance import distance
from pipeline.synthesis.images import Bytes, stacked
from pipeline.synthesis.tones import derived_guide, lab_guide

GUIDES = ("a", "b", "c")
LONGEST_PX = 16000
DARK = 128
GRAY_TOLERANCE = 8
"""Channels that differ by no more are one: video codecs tint gray a little."""


class JobSource:
    """`sources.Source` of a job without layers."""

    layer = WHOLE

    def __init__(self, bench: Bench, keyed: bool = False) -> None:
        self.params: AnalogyParams = bench.params
        self._bench, self._keyed = bench, keyed

    @property
    def found(self) -> str:
        return "tones"

    # -- the video

    @cached_property
    def guides(self) -> tuple[Guide, ...]:
        weights = {name: getattr(self.params, f"guide_{name}_weight") for name in GUIDES}
        return tuple(Guide(name, weights[name], self._channels(name)) for name in GUIDES if self._has(name))

    def _has(self, name: str) -> bool:
        return self._bench.has(f"guide_{name}")

    def _channels(self, name: str) -> int:
        """1 where the style's side of a guide is gray (or, if there is none, its first frame)."""
        field = f"style_guide_{name}"
        return 1 if gray(self._bench.image(field if self._bench.has(field) else f"guide_{name}")) else 3

    @cached_property
    def lined(self) -> bool:
        """Whether the job draws lines.

        Raises:
            BadInput: one of the two pictures of lines is missing.
        """
        given = {name for name in ("lines", "style_lines") if self._bench.has(name)}
        if len(given) == 1:
            missing = ({"lines", "style_lines"} - given).pop()
            raise BadInput(
                "Lines need both pictures of them: the video's and the style's.", field=f"inputs.{missing}",
                remedy=f"Give {missing}: black lines on white.",
            )  # fmt: skip
        return bool(given) and self.params.lines_weight > 0

    def pictures(self, start: int, stop: int) -> Iterator[Picture]:
        sources = {guide: self._bench.frames(f"guide_{guide.name}", start, stop) for guide in self.guides}
        drawn = self._bench.frames("lines", start, stop) if self.lined else None
        for frame in self._bench.frames("video", start, stop):
            planes = [plane_of(_next(s, f"guide_{g.name}", frame), g.channels) for g, s in sources.items()]
            lines = None if drawn is None else line_distance(_next(drawn, "lines", frame))
            yield Picture(frame, stacked(planes) if planes else None, lines)

    def velocities(self, first: int) -> tuple[Flow, Flow] | None:
        return None

    # -- keyframes

    def key_frames(self) -> tuple[int, ...]:
        return tuple(self._bench.images("keyframes")) if self._bench.has("keyframes") else ()

    def key(self, index: int) -> Key:
        masks = self._bench.images("masks") if self._bench.has("masks") else {}
        image = self._bench.images("keyframes")[index]
        return read_key(index, image, self._bench.size, masks.get(index), "inputs.keyframes")

    # -- the style

    def has_pair(self) -> bool:
        return self._bench.has("style_output")

    def pair(self) -> Pair:
        """Raises BadInput: a style without its output, sizes that differ, a guide without its counterpart."""
        bench = self._bench
        if not bench.has("style_output"):
            if bench.has("style"):
                raise BadInput(
                    "A style input needs its output: the painting of it.", field="inputs.style_output",
                    remedy="Give style_output too, or give the painting alone as style_output.",
                )  # fmt: skip
            plain, painting = own_pair(bench)
            return Pair(painting, lab_guide(plain), True, self._extra(painting), None, self._lines(painting))
        painting = bench.image("style_output")
        check_length(painting, "inputs.style_output")
        plain_given = fitting(bench.image("style"), painting, "inputs.style") if bench.has("style") else None
        return as_pair(painting, plain_given, self.params.style_smoothing, self._extra(painting), self._lines(painting))

    def _lines(self, painting: Frame) -> Plane | None:
        if not self.lined:
            return None
        return line_distance(fitting(self._bench.image("style_lines"), painting, "inputs.style_lines"))

    def _extra(self, painting: Frame) -> Bytes | None:
        """The style's side of the guides a, b, c that were given."""
        planes = []
        for guide in self.guides:
            field = f"style_guide_{guide.name}"
            if not self._bench.has(field):
                raise BadInput(
                    f"The guide {guide.name} needs its counterpart in the style.", field=f"inputs.{field}",
                    remedy=f"Give {field}, of the painting's size, or leave guide_{guide.name} out.",
                )  # fmt: skip
            picture = fitting(self._bench.image(field), painting, f"inputs.{field}")
            planes.append(plane_of(picture, guide.channels))
        return stacked(planes) if planes else None


def as_pair(
    painting: Bytes, plain: Frame | None, smoothing_px: float, extra: Bytes | None, lines: Plane | None
) -> Pair:
    """A painting (RGB, or RGBA) and what it is of; where that is not known, its own colours without strokes."""
    opaque = np.ascontiguousarray(painting[..., :3])
    guide = derived_guide(opaque, smoothing_px) if plain is None else lab_guide(plain)
    return Pair(painting, guide, plain is None, extra, None, lines)


def check_length(painting: Bytes, field: str) -> None:
    if max(painting.shape[:2]) > LONGEST_PX:
        raise BadInput(
            "The painting is too large.", field=field, value=f"{painting.shape[1]}x{painting.shape[0]}",
            remedy=f"At most {LONGEST_PX} px a side.",
        )  # fmt: skip


def gray(picture: Frame) -> bool:
    """Whether a picture's channels are one, but for a tint."""
    wide = picture.astype(np.int16)
    return int(np.abs(wide - wide[..., :1]).max()) <= GRAY_TOLERANCE


def plane_of(picture: Frame, channels: int) -> Bytes:
    """A guide's picture as one channel, or as it is."""
    return np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), np.uint8) if channels == 1 else picture


def line_distance(picture: Frame) -> Plane:
    """Distance to the dark pixels (below half) of a picture of lines, px."""
    return distance(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) < DARK, device())


def fitting(image: Frame, painting: Bytes, field: str) -> Frame:
    """The image, if it has the painting's size."""
    if image.shape[:2] != painting.shape[:2]:
        raise BadInput(
            "It must have the size of the painting.", field=field, value=f"{image.shape[1]}x{image.shape[0]}",
            remedy=f"Scale it to {painting.shape[1]}x{painting.shape[0]}, registered with the painting.",
        )  # fmt: skip
    return image


def _next(source: Iterator[Frame], name: str, frame: Frame) -> Frame:
    """The next frame of an input that goes with the video."""
    found = next(source, None)
    if found is None or found.shape != frame.shape:
        what = "ends before the video" if found is None else f"is {found.shape[1]}x{found.shape[0]}"
        raise BadInput(
            f"The input {name} {what}.", field=f"inputs.{name}",
            remedy=f"Give as many frames of {frame.shape[1]}x{frame.shape[0]} as the video has.",
        )  # fmt: skip
    return found

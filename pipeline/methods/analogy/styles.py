"""The style a job works with: what was given, or what takes its place, at every level."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from pipeline.compute import device
from pipeline.errors import BadInput
from pipeline.frames import Frame, Plane
from pipeline.methods.analogy.exemplar import own_pair
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.base import Bench
from pipeline.synthesis.distance import distance
from pipeline.synthesis.goal import Goal
from pipeline.synthesis.images import Bytes, Style, halved, packed, stacked
from pipeline.synthesis.orientation import orientation
from pipeline.synthesis.tones import derived_guide, lab_guide

GUIDES = ("a", "b", "c")
LONGEST_PX = 16000
DARK = 128


@dataclass(frozen=True)
class Pair:
    """S and S^ at full size."""

    output: Bytes
    """S^, uint8 (h, w, 3), or (h, w, 4) with opacity."""
    guide: Bytes
    """S in CIELAB, uint8 (h, w, 3)."""
    derived: bool
    """Whether S was made of S^."""
    extra: Bytes | None = None
    """Further guides, uint8 (h, w, n)."""
    usable: Bytes | None = None
    lines: Plane | None = None
    """Distance to the style's lines, px."""

    @property
    def guides(self) -> Bytes:
        return self.guide if self.extra is None else stacked([self.guide, self.extra])


def read_pair(bench: Bench) -> Pair:
    """`_read_pair`, with the style's lines if the job draws any."""
    pair = _read_pair(bench)
    if not has_lines(bench):
        return pair
    return replace(pair, lines=line_distance(_fitting(bench.image("style_lines"), pair.output, "inputs.style_lines")))


def _read_pair(bench: Bench) -> Pair:
    """The pair that the job's inputs give: painted and plain, painted alone, or our own where there is neither.

    Raises:
        BadInput: a style without its output, sizes that differ.
    """
    params: AnalogyParams = bench.params
    if not bench.has("style_output"):
        if bench.has("style"):
            raise BadInput(
                "A style input needs its output: the painting of it.",
                field="inputs.style_output",
                remedy="Give style_output too, or give the painting alone as style_output.",
            )
        plain, painting = own_pair()
        return Pair(painting, lab_guide(plain), derived=True, extra=_extra(bench, painting))
    painting = bench.image("style_output")
    if max(painting.shape[:2]) > LONGEST_PX:
        raise BadInput(
            "The painting is too large.", field="inputs.style_output",
            value=f"{painting.shape[1]}x{painting.shape[0]}", remedy=f"At most {LONGEST_PX} px a side.",
        )  # fmt: skip
    if bench.has("style"):
        plain = _fitting(bench.image("style"), painting, "inputs.style")
        return Pair(painting, lab_guide(plain), derived=False, extra=_extra(bench, painting))
    return Pair(painting, derived_guide(painting, params.style_smoothing), derived=True, extra=_extra(bench, painting))


def _extra(bench: Bench, painting: Frame) -> Bytes | None:
    """The style's side of the guides a, b, c that were given."""
    planes = []
    for name in given_guides(bench):
        field = f"style_guide_{name}"
        if not bench.has(field):
            raise BadInput(
                f"The guide {name} needs its counterpart in the style.",
                field=f"inputs.{field}", remedy=f"Give {field}, of the painting's size, or leave guide_{name} out.",
            )  # fmt: skip
        planes.append(cv2.cvtColor(_fitting(bench.image(field), painting, f"inputs.{field}"), cv2.COLOR_RGB2GRAY))
    return stacked([np.asarray(p, np.uint8) for p in planes]) if planes else None


def has_lines(bench: Bench) -> bool:
    """Whether the job draws lines.

    Raises:
        BadInput: one of the two pictures of lines is missing.
    """
    given = {name for name in ("lines", "style_lines") if bench.has(name)}
    if len(given) == 1:
        missing = ({"lines", "style_lines"} - given).pop()
        raise BadInput(
            "Lines need both pictures of them: the video's and the style's.", field=f"inputs.{missing}",
            remedy=f"Give {missing}: black lines on white.",
        )  # fmt: skip
    return bool(given) and bench.params.lines_weight > 0


def line_distance(picture: Frame) -> Plane:
    """Distance to the dark pixels (below half) of a picture of lines, px."""
    return distance(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) < DARK, device())


def given_guides(bench: Bench) -> tuple[str, ...]:
    """Which of the guides a, b, c the job has."""
    return tuple(name for name in GUIDES if bench.has(f"guide_{name}"))


def _fitting(image: Frame, painting: Frame, field: str) -> Frame:
    if image.shape[:2] != painting.shape[:2]:
        raise BadInput(
            "It must have the size of the painting.",
            field=field, value=f"{image.shape[1]}x{image.shape[0]}",
            remedy=f"Scale it to {painting.shape[1]}x{painting.shape[0]}, registered with style_output.",
        )  # fmt: skip
    return image


def goal_of(
    params: AnalogyParams, guides: tuple[str, ...], level: int, *, colours: int = 3, keyed: bool = False
) -> Goal:
    """The goal function of the parameters at a level: lengths in px shrink with it."""
    weight = params.guide_weight
    extra = tuple(getattr(params, f"guide_{name}_weight") for name in guides)
    half = 2.0**-level
    return Goal(
        colours=colours, radius=params.patch_radius, sigma_px=params.patch_sigma, w_out=params.texture_weight,
        guides=(weight, weight * params.colour_weight / 2, weight * params.colour_weight / 2, *extra),
        w_sc=params.coherence_weight, r_max_px2=params.coherence_limit,
        w_tc=0.0 if keyed or params.temporal == "off" else params.steadiness,
        w_h=params.variety_weight, h_limit=params.variety_limit,
        w_dt=params.lines_weight / half**2, d_max_px=params.lines_reach * half,
        w_din=params.change_weight if keyed else 0.0, w_dout=params.change_out_weight if keyed else 0.0,
    )  # fmt: skip


class Styles:
    """A pair at every level, made when asked for."""

    def __init__(self, pair: Pair, params: AnalogyParams) -> None:
        self._pairs = [pair]
        self._params = params

    @property
    def longest_px(self) -> int:
        """Of the finest level's sides."""
        return int(max(self._pairs[0].output.shape[:2]))

    @property
    def finest(self) -> Bytes:
        return self._pairs[0].output

    def at(self, level: int, goal: Goal) -> Style:
        """The style at a level, packed for a goal."""
        while len(self._pairs) <= level:
            self._pairs.append(_half(self._pairs[-1]))
        pair = self._pairs[level]
        colours = pair.output if self._params.colours == "rgb" else in_lab(pair.output)
        turning = self._params.rotation == "on"
        bins = orientation(np.ascontiguousarray(pair.guide[..., 0]), self._params.rotation_sigma) if turning else None
        return Style(pair.output, packed(goal, colours, pair.guides), bins, pair.usable, pair.lines)


def in_lab(output: Bytes) -> Bytes:
    """The colours in CIELAB, opacity as it is."""
    lab = np.asarray(cv2.cvtColor(np.ascontiguousarray(output[..., :3]), cv2.COLOR_RGB2Lab), np.uint8)
    return lab if output.shape[2] == 3 else np.dstack([lab, output[..., 3]])


def _half(pair: Pair) -> Pair:
    def bytes_of(image: Bytes) -> Bytes:
        return np.asarray(halved(image), np.uint8)

    return Pair(
        bytes_of(pair.output), bytes_of(pair.guide), pair.derived,
        None if pair.extra is None else bytes_of(pair.extra),
        None if pair.usable is None else np.asarray(halved(pair.usable, nearest=True), np.uint8),
        None if pair.lines is None else np.asarray(halved(pair.lines), np.float32) / np.float32(2),
    )  # fmt: skip

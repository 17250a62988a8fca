"""A layer of a shot (or the whole of it) as a source: rendered passes as guides, exact velocities, its own style.

Outside a layer's silhouette its colours, guides and velocities are those of the nearest pixel inside, so that paint
beyond the outline is compared with, and moves with, what it was painted on (section 4 of benard2013stylizing).
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from functools import cached_property

import numpy as np

from pipeline.compute import device
from pipeline.errors import BadInput
from pipeline.frames import Flow, Frame, Mask
from pipeline.methods.analogy.exemplar import default_pair
from pipeline.methods.analogy.job_source import (
    JobSource,
    as_pair,
    check_length,
    guide_plane,
    is_gray,
    line_distance,
    same_size,
)
from pipeline.methods.analogy.keyframes import Keyframe, eight_bit, read_keyframe
from pipeline.methods.analogy.layers import Layer, LayerStatistics, layer_params, layered_shot
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.passes import Passes
from pipeline.methods.analogy.sources import GUIDE_WEIGHT, WHOLE, Guide, Source, SourceFrame, StylePair, id_colours
from pipeline.methods.base import TaskContext
from pipeline.synthesis.distance import Sites, extrapolated, nearest, within_reach
from pipeline.synthesis.images import Bytes, stacked
from pipeline.video.exr import signed
from pipeline.video.guard.pictures import guarded_raw

BEYOND_PX = 64
"""Distance beyond the paint to which a layer's colours are extrapolated: the reach of a patch at the coarsest level."""
STYLE_REACH_PX = 24.0
"""Maximum distance of paint outside the silhouette when only the style, and no keyframe, has opacity, px."""
_KEPT = 8


class LayerSource:
    """`sources.Source` of a layer.

    Args:
        found: results of the scan; None during the scan.
        keyed: whether its keyframes are the style.
    """

    def __init__(
        self, context: TaskContext[AnalogyParams], layer: Layer, found: LayerStatistics | None, keyed: bool = False
    ) -> None:
        self.layer, self.params = layer.number, layer_params(context.params, layer)
        self._context, self._layer, self._keyed = context, layer, keyed
        self._passes = Passes(layer, context.size)
        self._found = found
        self._sites: OrderedDict[int, Sites] = OrderedDict()

    @property
    def statistics_artefact(self) -> str:
        return self._layer.artefact

    # -- frames

    @cached_property
    def guides(self) -> tuple[Guide, ...]:
        """Passes that have a counterpart in the style (with keyframes as style: all passes), and the user's guides."""
        weights = self._layer.files.settings.guides if self._layer.files.settings else {}
        names = [*self._passes.guide_names(), *(["mask"] if self.masked else [])]
        for name in weights:
            if name not in names:
                raise BadInput(
                    f"{self._layer.where} has no guide named {name}.", field=f"layers.{self._layer.name}.guides",
                    value=name,
                    remedy=f"It has: {', '.join(names) or 'none'}.",
                )  # fmt: skip
        chosen = [name for name in names if weights.get(name, GUIDE_WEIGHT) > 0 and self._shown(name)]
        return tuple(Guide(name, weights.get(name, GUIDE_WEIGHT), self._channels(name)) for name in chosen)

    def _shown(self, name: str) -> bool:
        """Whether the style has a counterpart of the guide.

        Raises:
            BadInput: a user's guide has no counterpart.
        """
        there = self._keyed or name in self._layer.style
        if not there and name not in ("mask", "ids", "normals"):
            raise BadInput(
                f"{self._layer.where}: the guide {name} has no counterpart in the style.",
                field=f"guides.{name}", remedy=f"Put {name}.png in style/, of the painting's size.",
            )  # fmt: skip
        return there

    def _channels(self, name: str) -> int:
        if name in ("mask", "ids", "normals"):
            return 1 if name == "mask" else 3
        picture = self._passes.guide(name, 0) if self._keyed else self._style_picture(name)
        return 1 if is_gray(picture) else 3

    @property
    def masked(self) -> bool:
        """Whether the layer covers only a part of the picture."""
        return self._passes.masked

    @property
    def has_lines(self) -> bool:
        """Whether lines are drawn: the style has them, or the style are keyframes, whose frames have them."""
        shown = self._keyed or {"lines", "output"} <= self._layer.style.keys()
        return shown and self._passes.has("lines") and self.params.lines_weight > 0

    def pictures(self, start: int, stop: int) -> Iterator[SourceFrame]:
        for index in range(start, min(stop, self._layer.frames)):
            yield self._picture(index)

    def _picture(self, index: int) -> SourceFrame:
        frame, mask = self._passes.frame(index), self._passes.mask(index)
        lines = line_distance(self._passes.lines(index)) if self.has_lines else None
        planes = [self._plane(guide, index, mask) for guide in self.guides]
        if mask is None:
            return SourceFrame(frame, stacked(planes) if planes else None, lines)
        sites = self._sites_of(index, mask)
        further = [
            plane if g.name == "mask" else extrapolated(plane, sites)
            for g, plane in zip(self.guides, planes, strict=True)
        ]
        return SourceFrame(
            extrapolated(frame, sites),
            stacked(further) if further else None,
            lines,
            within_reach(sites, self._reach),
            mask,
        )

    def _plane(self, guide: Guide, index: int, mask: Mask | None) -> Bytes:
        if guide.name == "mask" and mask is not None:
            return np.where(mask, 255, 0).astype(np.uint8)
        return guide_plane(self._passes.guide(guide.name, index), guide.channels)

    @property
    def _reach(self) -> float:
        return 0.0 if self._found is None else self._found.reach_px

    def _sites_of(self, index: int, mask: Mask) -> Sites:
        if index not in self._sites:
            self._sites[index] = nearest(mask, device(), int(self._reach) + BEYOND_PX)
            if len(self._sites) > _KEPT:
                self._sites.popitem(last=False)
        return self._sites[index]

    # -- velocities

    def velocities(self, first: int) -> tuple[Flow, Flow] | None:
        if self._found is None or self._found.factors is None:
            return None
        plus = signed(*self._passes.vectors(first), self._found.factors).plus
        minus = signed(*self._passes.vectors(first + 1), self._found.factors).minus
        if plus is None or minus is None:
            return None
        return self._beyond(plus, first), self._beyond(minus, first + 1)

    def _beyond(self, velocity: Flow, index: int) -> Flow:
        mask = self._passes.mask(index)
        return velocity if mask is None else extrapolated(velocity, self._sites_of(index, mask))

    # -- keyframes

    def key_frames(self) -> tuple[int, ...]:
        own = tuple(self._layer.files.passes["keyframes"])
        return own or (JobSource(self._context).key_frames() if self.layer == WHOLE else ())

    def key(self, index: int) -> Keyframe:
        """A keyframe. For a layer with a silhouette alpha is opacity; otherwise alpha marks the painted pixels."""
        paths = self._layer.files.passes
        if index not in paths["keyframes"]:
            return JobSource(self._context).key(index)
        painted = self._raw(paths["painted"][index]) if index in paths["painted"] else None
        image, where = self._raw(paths["keyframes"][index]), paths["keyframes"][index]
        if not self.masked:
            return read_keyframe(index, image, self._context.size, painted, where)
        eight = eight_bit(image)
        opaque = np.dstack([eight] * 3) if eight.ndim == 2 else eight[..., :3]
        key = read_keyframe(index, opaque, self._context.size, painted, where)
        opacity = eight[..., 3] if eight.ndim == 3 and eight.shape[2] == 4 else self._silhouette(index)
        return Keyframe(index, np.ascontiguousarray(np.dstack([key.colours, opacity])), key.painted)

    def _silhouette(self, index: int) -> Bytes:
        mask = self._passes.mask(index)
        assert mask is not None
        return np.where(mask, 255, 0).astype(np.uint8)

    def overpaint_px(self) -> float:
        """Maximum distance of paint beyond the silhouette, px."""
        says = self._layer.files.settings
        if says is not None and says.overpaint_px is not None:
            return says.overpaint_px
        if not self.masked:
            return 0.0
        if not self.key_frames():
            return STYLE_REACH_PX if self.has_pair() and self.pair().output.shape[2] == 4 else 0.0
        return max(self._paint_beyond(index) for index in self.key_frames())

    def _paint_beyond(self, index: int) -> float:
        mask, paint = self._passes.mask(index), self.key(index).colours[..., 3] > 0
        if mask is None or not mask.any() or not paint.any():
            return 0.0
        sites = nearest(mask, device())
        y, x = np.nonzero(paint)
        return float(np.ceil(np.hypot(sites[y, x, 0] - x, sites[y, x, 1] - y).max())) + 1

    # -- the style

    def has_pair(self) -> bool:
        return "output" in self._layer.style or self._context.has("style_output")

    def pair(self) -> StylePair:
        style = self._layer.style
        if "output" not in style:
            return self._lent()
        painting = eight_bit(self._raw(style["output"]))
        painting = np.dstack([painting] * 3) if painting.ndim == 2 else painting
        check_length(painting, style["output"])
        if not self.masked:
            painting = np.ascontiguousarray(painting[..., :3])
        plain = same_size(self._style_picture("input"), painting, style["input"]) if "input" in style else None
        lines = self._style_lines(painting) if self.has_lines and "lines" in style else None
        return as_pair(painting, plain, self.params.style_smoothing, self._extra(painting), lines)

    def _lent(self) -> StylePair:
        """The style pair of the job, or the default pair; without guides."""
        if "input" in self._layer.style:
            raise BadInput(
                f"{self._layer.where}: the style has an input but no output (the painting).", field="style/output.png",
                remedy="Put the painting of style/input.png there.",
            )  # fmt: skip
        if self._context.has("style_output") or self._context.has("style"):
            return JobSource(self._context).pair()
        plain, painting = default_pair(self._context)
        return as_pair(painting, plain, 0.0, None, None)

    def _style_lines(self, painting: Bytes) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
        return line_distance(same_size(self._style_picture("lines"), painting, self._layer.style["lines"]))

    def _extra(self, painting: Bytes) -> Bytes | None:
        planes = [guide_plane(self._style_guide(g.name, painting), g.channels) for g in self.guides]
        return stacked(planes) if planes else None

    def _style_guide(self, name: str, painting: Bytes) -> Frame:
        path = self._layer.style[name]
        raw = self._raw(path)
        picture = id_colours(raw) if name == "ids" and raw.ndim == 2 else self._style_picture(name)
        return same_size(picture, painting, path)

    def _style_picture(self, stem: str) -> Frame:
        eight = eight_bit(self._raw(self._layer.style[stem]))
        return np.dstack([eight] * 3) if eight.ndim == 2 else np.ascontiguousarray(eight[..., :3])

    def _raw(self, path: str) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
        return guarded_raw(self._layer.all[path], path)


def source_of(context: TaskContext[AnalogyParams], layer: int, keyed: bool = False) -> Source:
    """The source of a layer (-1 = the whole picture), with the results of the scan.

    Args:
        keyed: whether painted keyframes are the style.
    """
    shot = layered_shot(context)
    if shot is None:
        return JobSource(context, keyed)
    chosen = shot.layer(layer)
    return LayerSource(context, chosen, LayerStatistics.of(context.load("scan", chosen.artefact)), keyed)

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
from pipeline.methods.analogy.exemplar import own_pair
from pipeline.methods.analogy.job_source import JobSource, as_pair, check_length, fitting, gray, line_distance, plane_of
from pipeline.methods.analogy.keys import Key, eight_bit, read_key
from pipeline.methods.analogy.layers import Found, Layer, layer_params
from pipeline.methods.analogy.passes import Passes
from pipeline.methods.analogy.sources import GUIDE_WEIGHT, WHOLE, Guide, Pair, Picture, coded
from pipeline.methods.base import Bench
from pipeline.synthesis.distance import Sites, extrapolated, nearest, within
from pipeline.synthesis.images import Bytes, stacked
from pipeline.video.exr import signed
from pipeline.video.guard.pictures import guarded_raw

BEYOND_PX = 64
"""How far beyond the paint a layer's colours go on: as far as a patch of the coarsest level sees."""
STYLE_REACH_PX = 24.0
"""How far paint may lie outside where the style, and no key, has opacity."""
_KEPT = 8


class LayerSource:
    """`sources.Source` of a layer.

    Args:
        found: what the scan has found of it; None while scanning.
        keyed: whether its keys are the style, or the style pair is.
    """

    def __init__(self, bench: Bench, layer: Layer, found: Found | None, keyed: bool = False) -> None:
        self.layer, self.params = layer.number, layer_params(bench.params, layer)
        self._bench, self._layer, self._keyed = bench, layer, keyed
        self._passes = Passes(layer, bench.size)
        self._found = found
        self._sites: OrderedDict[int, Sites] = OrderedDict()

    @property
    def found(self) -> str:
        return self._layer.artefact

    # -- frames

    @cached_property
    def guides(self) -> tuple[Guide, ...]:
        """Passes that the style shows as well (with keys as style: all of them), and the user's."""
        weights = self._layer.files.says.guides if self._layer.files.says else {}
        names = [*self._passes.guide_names(), *(["mask"] if self.masked else [])]
        for name in weights:
            if name not in names:
                raise BadInput(
                    f"{self._layer.where} has no guide {name}.", field=f"layers.{self._layer.name}.guides", value=name,
                    remedy=f"It has: {', '.join(names) or 'none'}.",
                )  # fmt: skip
        chosen = [name for name in names if weights.get(name, GUIDE_WEIGHT) > 0 and self._shown(name)]
        return tuple(Guide(name, weights.get(name, GUIDE_WEIGHT), self._channels(name)) for name in chosen)

    def _shown(self, name: str) -> bool:
        """Whether the style has the guide's counterpart.

        Raises:
            BadInput: a guide of the user's has none.
        """
        there = self._keyed or name in self._layer.style
        if not there and name not in ("mask", "ids", "normals"):
            raise BadInput(
                f"{self._layer.where}: the guide {name} needs its counterpart in the style.",
                field=f"guides.{name}", remedy=f"Put {name}.png in style/, of the painting's size.",
            )  # fmt: skip
        return there

    def _channels(self, name: str) -> int:
        if name in ("mask", "ids", "normals"):
            return 1 if name == "mask" else 3
        picture = self._passes.guide(name, 0) if self._keyed else self._style_picture(name)
        return 1 if gray(picture) else 3

    @property
    def masked(self) -> bool:
        """Whether the layer is but a part of the picture."""
        return self._passes.masked

    @property
    def lined(self) -> bool:
        return self._passes.has("lines") and "lines" in self._layer.style and self.params.lines_weight > 0

    def pictures(self, start: int, stop: int) -> Iterator[Picture]:
        for index in range(start, min(stop, self._layer.frames)):
            yield self._picture(index)

    def _picture(self, index: int) -> Picture:
        frame, mask = self._passes.frame(index), self._passes.mask(index)
        lines = line_distance(self._passes.lines(index)) if self.lined else None
        planes = [self._plane(guide, index, mask) for guide in self.guides]
        if mask is None:
            return Picture(frame, stacked(planes) if planes else None, lines)
        sites = self._sites_of(index, mask)
        further = [
            plane if g.name == "mask" else extrapolated(plane, sites)
            for g, plane in zip(self.guides, planes, strict=True)
        ]
        return Picture(
            extrapolated(frame, sites), stacked(further) if further else None, lines, within(sites, self._reach), mask
        )

    def _plane(self, guide: Guide, index: int, mask: Mask | None) -> Bytes:
        if guide.name == "mask" and mask is not None:
            return np.where(mask, 255, 0).astype(np.uint8)
        return plane_of(self._passes.guide(guide.name, index), guide.channels)

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
        return own or (JobSource(self._bench).key_frames() if self.layer == WHOLE else ())

    def key(self, index: int) -> Key:
        """Of a layer that is a part of the picture, alpha is opacity; of the whole, it says where it is painted."""
        paths = self._layer.files.passes
        if index not in paths["keyframes"]:
            return JobSource(self._bench).key(index)
        painted = self._raw(paths["painted"][index]) if index in paths["painted"] else None
        image, where = self._raw(paths["keyframes"][index]), paths["keyframes"][index]
        if not self.masked:
            return read_key(index, image, self._bench.size, painted, where)
        eight = eight_bit(image)
        opaque = np.dstack([eight] * 3) if eight.ndim == 2 else eight[..., :3]
        key = read_key(index, opaque, self._bench.size, painted, where)
        opacity = eight[..., 3] if eight.ndim == 3 and eight.shape[2] == 4 else self._silhouette(index)
        return Key(index, np.ascontiguousarray(np.dstack([key.colours, opacity])), key.painted)

    def _silhouette(self, index: int) -> Bytes:
        mask = self._passes.mask(index)
        assert mask is not None
        return np.where(mask, 255, 0).astype(np.uint8)

    def overpaint_px(self) -> float:
        """How far its keys are painted beyond the silhouette."""
        says = self._layer.files.says
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
        return "output" in self._layer.style or self._bench.has("style_output")

    def pair(self) -> Pair:
        style = self._layer.style
        if "output" not in style:
            return self._lent()
        painting = eight_bit(self._raw(style["output"]))
        painting = np.dstack([painting] * 3) if painting.ndim == 2 else painting
        check_length(painting, style["output"])
        if not self.masked:
            painting = np.ascontiguousarray(painting[..., :3])
        plain = fitting(self._style_picture("input"), painting, style["input"]) if "input" in style else None
        lines = self._style_lines(painting) if self.lined else None
        return as_pair(painting, plain, self.params.style_smoothing, self._extra(painting), lines)

    def _lent(self) -> Pair:
        """The job's style pair, or our own: without guides."""
        if "input" in self._layer.style:
            raise BadInput(
                f"{self._layer.where}: the style needs its output, the painting.", field="style/output.png",
                remedy="Put the painting of style/input.png there.",
            )  # fmt: skip
        if self._bench.has("style_output") or self._bench.has("style"):
            return JobSource(self._bench).pair()
        plain, painting = own_pair(self._bench)
        return as_pair(painting, plain, 0.0, None, None)

    def _style_lines(self, painting: Bytes) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
        return line_distance(fitting(self._style_picture("lines"), painting, self._layer.style["lines"]))

    def _extra(self, painting: Bytes) -> Bytes | None:
        planes = [plane_of(self._style_guide(g.name, painting), g.channels) for g in self.guides]
        return stacked(planes) if planes else None

    def _style_guide(self, name: str, painting: Bytes) -> Frame:
        path = self._layer.style[name]
        raw = self._raw(path)
        picture = coded(raw) if name == "ids" and raw.ndim == 2 else self._style_picture(name)
        return fitting(picture, painting, path)

    def _style_picture(self, stem: str) -> Frame:
        eight = eight_bit(self._raw(self._layer.style[stem]))
        return np.dstack([eight] * 3) if eight.ndim == 2 else np.ascontiguousarray(eight[..., :3])

    def _raw(self, path: str) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
        return guarded_raw(self._layer.all[path], path)

"""Inputs of a layer of a shot, or of the whole shot: render passes as guides, exact velocities, its own style.

Outside a layer's silhouette its colours, guides and velocities are those of the nearest pixel inside, so that paint
beyond the outline is compared with the layer below it, and moves with it (section 4 of benard2013stylizing).
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cached_property, partial
from itertools import chain

import numpy as np

from pipeline.arrays import AnyArray
from pipeline.compute import device
from pipeline.errors import BadInput
from pipeline.formats import has_planes
from pipeline.frames import Flow, Frame, Mask, Plane
from pipeline.methods.analogy.automatic_guides import automatic_guides, automatic_planes
from pipeline.methods.analogy.data_images import (
    FLOAT_PASSES,
    PASS_COLOURS,
    PASSES_IN_FRAMES,
    UNIT,
    Range,
    data_picture,
    direction_data,
    range_of,
    read_data,
)
from pipeline.methods.analogy.inputs import (
    GUIDE_WEIGHT,
    OPAQUE,
    WHOLE,
    Guide,
    InputFrame,
    Keyframe,
    StylePair,
    SynthesisInputs,
    eight_bit,
    id_colours,
    read_keyframe,
)
from pipeline.methods.analogy.job_inputs import (
    JobInputs,
    check_painting_size,
    guide_plane,
    is_gray,
    line_distance,
    make_style_pair,
    same_size,
)
from pipeline.methods.analogy.params import AnalogyParams
from pipeline.methods.analogy.render_passes import RenderPasses, as_rgb
from pipeline.methods.analogy.shot_layers import (
    Layer,
    LayerStatistics,
    layer_params,
    layered_shot,
)
from pipeline.methods.analogy.style_images import default_pair
from pipeline.methods.base import TaskContext
from pipeline.passes.find import ANYWHERE
from pipeline.synthesis.distance import Sites, extrapolated, nearest, within_reach
from pipeline.synthesis.images import Bytes, stacked
from pipeline.synthesis.orientation import authored_tensors
from pipeline.synthesis.tone_matching import smoothed
from pipeline.video.guard.pictures import guarded_planes, guarded_raw

EXTRAPOLATED_PX = 64
"""Distance beyond the paint to which a layer's colours are extrapolated, px: the reach of a patch at the coarsest
level."""
STYLE_OVERPAINT_PX = 24.0
"""Maximum distance of paint outside the silhouette when only the style, and no keyframe, has opacity, px."""
_MAX_CACHED_SITES = 8
"""Number of frames whose nearest silhouette pixels are in memory."""


class LayerInputs:
    """`SynthesisInputs` of a layer.

    Args:
        statistics: results of the step `scan` for the layer; None during the scan.
        keyframe_style: whether the keyframes are the style.
    """

    def __init__(
        self,
        context: TaskContext[AnalogyParams],
        layer: Layer,
        statistics: LayerStatistics | None,
        keyframe_style: bool = False,
    ) -> None:
        self.layer, self.params = layer.number, layer_params(context.params, layer)
        self._context, self._layer, self._keyframe_style = context, layer, keyframe_style
        self._passes = RenderPasses(layer, context.size)
        self._statistics = statistics
        self._sites: OrderedDict[int, Sites] = OrderedDict()

    @property
    def statistics_artefact(self) -> str:
        return self._layer.statistics_artefact

    # -- frames

    @cached_property
    def guides(self) -> tuple[Guide, ...]:
        """The given guides, and those that are computed."""
        return (*self._given_guides, *automatic_guides(self.params))

    @cached_property
    def _given_guides(self) -> tuple[Guide, ...]:
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
        chosen = [name for name in names if weights.get(name, GUIDE_WEIGHT) > 0 and self._in_style(name, weights)]
        return tuple(Guide(name, weights.get(name, GUIDE_WEIGHT), self._channels(name)) for name in chosen)

    def _in_style(self, name: str, weights: Mapping[str, float]) -> bool:
        """Whether the style has a counterpart of the guide. Keyframes have one of each, because their frames have it;
        depth, positions and texture coordinates in the frames are used only where the user names them.

        Raises:
            BadInput: a guide that the user gave or named has no counterpart.
        """
        own = name in self._layer.files.guides or name in self._layer.whole.guides
        keyed = self._keyframe_style and not (self.layer == WHOLE and self.has_style_pair())
        found = name in self._layer.style or (keyed and (own or name not in FLOAT_PASSES or name in weights))
        if not found and (own or name in weights):
            raise BadInput(
                f"{self._layer.where}: the guide {name} has no counterpart in the style.",
                field=f"guides.{name}", remedy=f"Put {name}.png of the painting's size into style/.",
            )  # fmt: skip
        return found

    def _channels(self, name: str) -> int:
        if name in ("mask", "ids", "normals"):
            return 1 if name == "mask" else 3
        return 1 if is_gray(self._guide(name, 0) if self._keyframe_style else self._style_guide(name)) else 3

    def _guide(self, name: str, index: int) -> Frame:
        return self._passes.guide(name, index, self._range(name))

    def _range(self, name: str) -> Range:
        return UNIT if self._statistics is None else self._statistics.ranges.get(name, UNIT)

    def ranges(self) -> dict[str, Range]:
        """Ranges of the guides that have values outside 0..1, in all frames and in the style."""
        found = {}
        for guide in self._given_guides:
            if guide.name in ("mask", "ids", "normals"):
                continue
            path = self._layer.style.get(guide.name)
            style = [read_data(self._layer.contents, path)] if path else []
            is_float = self._passes.guide_data(guide.name, 0).dtype == np.float32
            numbers = range(self._layer.frames if is_float else 0)
            found[guide.name] = range_of(chain(style, (self._passes.guide_data(guide.name, k) for k in numbers)))
        return {name: limits for name, limits in found.items() if limits != UNIT}

    @property
    def masked(self) -> bool:
        """Whether the layer covers only a part of the picture."""
        return self._passes.masked

    @property
    def has_lines(self) -> bool:
        """Whether lines are drawn: the style has lines, or the keyframes are the style and their frames have lines."""
        in_style = self._keyframe_style or {"lines", "output"} <= self._layer.style.keys()
        return in_style and self._passes.has("lines") and self.params.lines_weight > 0

    @property
    def rotates(self) -> bool:
        given = self._passes.has("directions") or "directions" in self._layer.style
        return given if self.params.rotation == "auto" else self.params.rotation == "on"

    def frames(self, start: int, stop: int) -> Iterator[InputFrame]:
        for index in range(start, min(stop, self._layer.frames)):
            yield self._frame(index)

    def _frame(self, index: int) -> InputFrame:
        frame, mask = self._passes.frame(index), self._passes.mask(index)
        distance_px = line_distance(self._passes.picture("lines", index)) if self.has_lines else None
        planes = [self._guide_plane(guide, index, mask) for guide in self._given_guides]
        planes += automatic_planes(automatic_guides(self.params), frame)
        directions = self._directions(index)
        if mask is None:
            return InputFrame(frame, stacked(planes) if planes else None, distance_px, directions=directions)
        sites = self._sites_of(index, mask)
        guides = [
            plane if guide.name == "mask" else extrapolated(plane, sites)
            for guide, plane in zip(self.guides, planes, strict=True)
        ]
        paintable = within_reach(sites, self._reach_px)
        return InputFrame(
            extrapolated(frame, sites), stacked(guides) if guides else None, distance_px, paintable, mask,
            None if directions is None else extrapolated(directions, sites),
        )  # fmt: skip

    def _directions(self, index: int) -> Plane | None:
        """The given directions of a frame, see `authored_tensors`; None = none are given, or patches do not rotate."""
        if not self.rotates or not self._passes.has("directions"):
            return None
        return self._passes.directions(index)

    def _guide_plane(self, guide: Guide, index: int, mask: Mask | None) -> Bytes:
        if guide.name == "mask" and mask is not None:
            return np.where(mask, 255, 0).astype(np.uint8)
        return guide_plane(self._guide(guide.name, index), guide.channels)

    @property
    def _reach_px(self) -> float:
        """Maximum distance of paint beyond the silhouette, px."""
        return 0.0 if self._statistics is None else self._statistics.reach_px

    def _sites_of(self, index: int, mask: Mask) -> Sites:
        """The nearest pixel of the silhouette for each pixel near it, see `nearest`."""
        if index not in self._sites:
            self._sites[index] = nearest(mask, device(), int(self._reach_px) + EXTRAPOLATED_PX)
            if len(self._sites) > _MAX_CACHED_SITES:
                self._sites.popitem(last=False)
        return self._sites[index]

    # -- velocities

    def velocities(self, first: int) -> tuple[Flow, Flow] | None:
        if self._statistics is None or self._statistics.factors is None:
            return None
        plus, minus = self._passes.velocities(first, self._statistics.factors, self._statistics.way)
        return self._extrapolated_velocity(plus, first), self._extrapolated_velocity(minus, first + 1)

    def _extrapolated_velocity(self, velocity: Flow, index: int) -> Flow:
        """Velocity extrapolated beyond the silhouette (section 4 of benard2013stylizing)."""
        mask = self._passes.mask(index)
        return velocity if mask is None else extrapolated(velocity, self._sites_of(index, mask))

    # -- keyframes

    def keyframe_numbers(self) -> tuple[int, ...]:
        own = tuple(self._layer.files.passes["keyframes"])
        return own or (JobInputs(self._context).keyframe_numbers() if self.layer == WHOLE else ())

    def keyframe(self, index: int) -> Keyframe:
        """A keyframe. Alpha is opacity for a layer with a silhouette; otherwise it marks the painted pixels."""
        paths = self._layer.files.passes
        if index not in paths["keyframes"]:
            return JobInputs(self._context).keyframe(index)
        painted = self._passes.picture("painted", index) if index in paths["painted"] else None
        where = paths["keyframes"][index]
        image = self._passes.fitted(self._raw(where))
        if not self.masked:
            under = partial(self._passes.frame, index) if self.params.key_transparency == "glaze" else None
            return read_keyframe(index, image, self._context.size, painted, where, under)
        pixels = eight_bit(image)
        key = read_keyframe(index, as_rgb(pixels), self._context.size, painted, where)
        opacity = pixels[..., 3] if pixels.ndim == 3 and pixels.shape[2] == 4 else self._silhouette(index)
        return Keyframe(index, np.ascontiguousarray(np.dstack([key.colours, opacity])), key.painted)

    def _silhouette(self, index: int) -> Bytes:
        """Opacity of a keyframe without opacity, uint8 (h, w): 255 within `overpaint_px` of the silhouette, else 0."""
        mask, settings = self._passes.mask(index), self._layer.files.settings
        assert mask is not None
        reach_px = (settings.overpaint_px or 0) * self._passes.ratio if settings is not None else 0
        covered = within_reach(nearest(mask, device(), int(reach_px) + 1), reach_px) if reach_px else mask
        return np.where(covered, 255, 0).astype(np.uint8)

    def overpaint_px(self) -> float:
        """Maximum distance of paint beyond the silhouette, px."""
        settings = self._layer.files.settings
        if settings is not None and settings.overpaint_px is not None:
            return settings.overpaint_px * self._passes.ratio
        if not self.masked:
            return 0.0
        if not self.keyframe_numbers():
            translucent = self.has_style_pair() and self.style_pair().output.shape[2] == 4
            return STYLE_OVERPAINT_PX * self._passes.ratio if translucent else 0.0
        return max(self._overpaint_of_key(index) for index in self.keyframe_numbers())

    def _overpaint_of_key(self, index: int) -> float:
        """Maximum distance of a keyframe's paint beyond the silhouette, px."""
        mask, paint = self._passes.mask(index), self.keyframe(index).colours[..., 3] > 0
        if mask is None or not mask.any() or not paint.any():
            return 0.0
        sites = nearest(mask, device())
        y, x = np.nonzero(paint)
        return float(np.ceil(np.hypot(sites[y, x, 0] - x, sites[y, x, 1] - y).max())) + 1

    # -- the style

    def has_style_pair(self) -> bool:
        return "output" in self._layer.style or self._context.has("style_output")

    @property
    def painting_alone(self) -> bool:
        style = self._layer.style
        return set(style) == {"output"} if style else JobInputs(self._context).painting_alone

    def style_pair(self) -> StylePair:
        style = self._layer.style
        if "output" not in style:
            return self._style_pair_of_job()
        painting = eight_bit(self._raw(style["output"]))
        painting = np.dstack([painting] * 3) if painting.ndim == 2 else painting
        check_painting_size(painting, style["output"])
        painting, usable = self._with_opacity(painting)
        plain = same_size(self._style_picture("input"), painting, style["input"]) if "input" in style else None
        lines = self._style_lines(painting) if self.has_lines and "lines" in style else None
        smoothing_px, opaque = self.params.style_smoothing, np.ascontiguousarray(painting[..., :3])
        guides = self._style_guides(painting, smoothed(opaque, smoothing_px) if plain is None else plain)
        pair = make_style_pair(painting, plain, smoothing_px, guides, lines)
        return replace(pair, directions=self._style_directions(painting), usable=usable)

    def _with_opacity(self, painting: Bytes) -> tuple[Bytes, Bytes | None]:
        """A painting, and its usable pixels, see `StylePair.usable`.

        Opacity is part of the style if the guide `mask` tells where the layer ends. Otherwise any transparent pixel
        would be as good as any other: transparent pixels are then not used, and get the nearest opaque colour.

        Raises:
            BadInput: no pixel is opaque.
        """
        if painting.shape[2] == 3 or any(guide.name == "mask" for guide in self.guides):
            return painting, None
        known, colours = painting[..., 3] >= OPAQUE, np.ascontiguousarray(painting[..., :3])
        if known.all():
            return colours, None
        if not known.any():
            raise BadInput(
                f"{self._layer.where}: the painting is completely transparent.", field=self._layer.style["output"],
                remedy="Save it with its colours, or remove it.",
            )  # fmt: skip
        return extrapolated(colours, nearest(known, device())), known.astype(np.uint8)

    def _style_directions(self, painting: Bytes) -> Plane | None:
        if not self.rotates or "directions" not in self._layer.style:
            return None
        path = self._layer.style["directions"]
        return authored_tensors(same_size(direction_data(self._layer.contents, path), painting, path))

    def _style_pair_of_job(self) -> StylePair:
        """The style pair of the job, or the default pair; without guides."""
        if "input" in self._layer.style:
            raise BadInput(
                f"{self._layer.where}: the style has an input but no output (the painting).", field="style/output.png",
                remedy="Put the painting of style/input.png there.",
            )  # fmt: skip
        if self._context.has("style_output") or self._context.has("style"):
            return JobInputs(self._context).style_pair()
        plain, painting = default_pair(self._context)
        planes = automatic_planes(automatic_guides(self.params), plain)
        return make_style_pair(painting, plain, 0.0, stacked(planes) if planes else None, None)

    def _style_lines(self, painting: Bytes) -> Plane:
        path = self._layer.style["lines"]
        return line_distance(same_size(data_picture(read_data(self._layer.contents, path)), painting, path))

    def _style_guides(self, painting: Bytes, scene: Frame) -> Bytes | None:
        """Style counterparts of the guides, uint8 (h, w, n); those that are computed, of the painting's scene."""
        paths = {guide: self._layer.style[guide.name] for guide in self._given_guides}
        pictures = {guide: same_size(self._style_guide(guide.name), painting, path) for guide, path in paths.items()}
        planes = [guide_plane(picture, guide.channels) for guide, picture in pictures.items()]
        planes += automatic_planes(automatic_guides(self.params), scene)
        return stacked(planes) if planes else None

    def _style_guide(self, name: str) -> Frame:
        path = self._layer.style[name]
        if has_planes(path) and name in PASSES_IN_FRAMES:
            found = PASSES_IN_FRAMES[name](guarded_planes(self._layer.contents[path], path), ANYWHERE)
            if found is not None:
                return data_picture(found, self._range(name)) if name in FLOAT_PASSES else PASS_COLOURS[name](found)
        data = read_data(self._layer.contents, path)
        return id_colours(data) if name == "ids" and data.ndim == 2 else data_picture(data, self._range(name))

    def _style_picture(self, stem: str) -> Frame:
        return as_rgb(eight_bit(self._raw(self._layer.style[stem])))

    def _raw(self, path: str) -> AnyArray:
        """Decoded picture of a file of the shot: uint8 or uint16, gray, RGB or RGBA."""
        return guarded_raw(self._layer.contents[path], path)


def inputs_of(context: TaskContext[AnalogyParams], layer: int, keyframe_style: bool = False) -> SynthesisInputs:
    """Inputs of a layer (-1 = the whole picture), with the results of the step `scan`.

    Args:
        keyframe_style: whether the keyframes are the style.
    """
    shot = layered_shot(context)
    chosen = None if shot is None else shot.layer(layer)
    artefact = JobInputs.statistics_artefact if chosen is None else chosen.statistics_artefact
    statistics = LayerStatistics.of(context.load("scan", artefact))
    if chosen is None:
        return JobInputs(context, keyframe_style, statistics)
    return LayerInputs(context, chosen, statistics, keyframe_style)

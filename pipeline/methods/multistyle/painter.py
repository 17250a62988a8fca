"""Painting of an analysed frame. The painter keeps at most the few previous paintings of temporal accumulation."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import AnyArray, Arrays, State, flatten, part
from pipeline.frames import Frame, Plane
from pipeline.kernels.buffers import Buffers
from pipeline.kernels.float16 import to_single
from pipeline.methods.multistyle.analysis import StrokeAnalysis, StrokeLayer, unpack
from pipeline.methods.multistyle.params import MultistyleParams
from pipeline.methods.multistyle.shared_paintings import SHARED
from pipeline.methods.multistyle.styles import STYLES, pigment
from pipeline.methods.tasks import Clock, no_clock
from pipeline.strokes.accumulation import Painting, accumulate, accumulated_coverage
from pipeline.strokes.brush import HEIGHT, TARGET, Canvas, Direction
from pipeline.strokes.emboss import Lighting, Painted, emboss
from pipeline.strokes.paper import settle_pigment
from pipeline.strokes.raster import StrokeTrace, paint
from pipeline.strokes.seeds import StyleField
from pipeline.strokes.streamlines_forward import (
    TRANSMITTANCE,
    FrontToBack,
    RasterOptions,
    clear,
    composite_over,
    empty_buffer,
    streamlines_forward,
)
from pipeline.strokes.trace import TraceRules, trace_from, unit_tangents
from pipeline.strokes.tracks import fade
from pipeline.video.depth import as_uint16, white_of, with_opacity


@dataclass(frozen=True)
class PainterParams:
    """Constants of painting."""

    paper_grain: float = 0.09
    """Relative darkening of thick paint in hollows of the paper with a depth of one standard deviation, at `paper`
    1."""
    rounding: float = 0.0018
    least_rounding_px: float = 0.35
    """Sigma of the blur of the paint height, as a fraction of the picture's shorter side, and the sigma below which
    it is skipped. With it the slopes, and so the lighting, are alike at every picture size."""
    cover_limit: float = 60.0
    """Limit, gray levels, of the change that the ground colour makes, so that ground in dark places does not glare."""


PAINTER = PainterParams()


def accumulated_frames(params: MultistyleParams) -> int:
    """Number of previous paintings that each painting is averaged with."""
    if params.temporal == "off" or params.renderer == "explicit" or not params.accumulated_frames:
        return 0
    return params.accumulated_frames + STYLES[params.style].extra_frames


TRACED_LAYERS = 4


@dataclass(frozen=True)
class Traces:
    """Which strokes a frame shows.

    Attributes:
        owners: uint32 (h, w), the number (`stroke_numbers`) of the stroke that a pixel shows most; 0: the ground.
        shares: float32 (h, w, TRACED_LAYERS), share of the pixel that shows each layer of strokes, from coarse to fine;
            further layers, as that of faces, count as the last one.
    """

    owners: NDArray[np.uint32]
    shares: NDArray[np.float32]

    @classmethod
    def of(cls, size: tuple[int, int]) -> Traces:
        shape = size[::-1]
        return cls(np.zeros(shape, np.uint32), np.zeros((*shape, TRACED_LAYERS), np.float32))

    def add(self, layer: int, transmittance: Plane) -> None:
        """Add a layer, after the finer ones: `transmittance` of all up to it, float32 (h, w)."""
        self.shares[..., min(layer, TRACED_LAYERS - 1)] += 1 - transmittance - self.shares.sum(axis=2)

    def lay_over(self, layer: int, cover: Plane) -> None:
        """Add a layer, after the coarser ones: share of a pixel that its strokes cover, float32 (h, w)."""
        np.multiply(self.shares, 1 - cover[..., None], out=self.shares)
        self.shares[..., min(layer, TRACED_LAYERS - 1)] += cover


class Painter:
    """Paints consecutive frames of one size. Not thread-safe.

    With `opaque` false, it paints on nothing instead of a ground, so that a painting has an opacity: the coverage of
    its strokes.

    The only state is the previous paintings. A painter that gets the previous analyses (`load_previous`) continues
    with the same bytes.

    Args:
        size: (width, height), px.
        seed: random seed.
        threads: bands of rows that the implicit renderers paint concurrently; the bytes are the same.
        deep: whether frames are uint16.
        opaque: whether frames have no opacity. Explicit strokes are always opaque.
        traced: whether `traces` of the last painted frame are kept.
    """

    def __init__(
        self, params: MultistyleParams, size: tuple[int, int], seed: int, clock: Clock = no_clock, threads: int = 1,
        deep: bool = False, opaque: bool = True, traced: bool = False,
    ) -> None:  # fmt: skip
        self.deep, self.opaque, self.traced = deep, opaque, traced
        self.traces: Traces | None = None
        self.params, self.size, self.seed, self.clock, self.threads = params, size, seed, clock, threads
        self.accumulated = accumulated_frames(params)
        self.past: list[tuple[StrokeAnalysis, Painting]] = []
        self.scratch: tuple[FrontToBack, Canvas] | None = None  # kept from frame to frame: new memory must be paged in
        self.buffers = Buffers()

    def paint(self, analysis: StrokeAnalysis, shared: bool = False, matte: AnyArray | None = None) -> AnyArray:
        """Paint a frame: uint8 or uint16 (h, w, 3), or (h, w, 4) with straight opacity.

        Args:
            shared: whether the next run of frames recalls this frame, perhaps in another thread of this process.
            matte: opacity of the source, of any type (h, w, n): strokes that begin where it is 0 are not painted; None:
                it is opaque.
        """
        now = self._painted(analysis, shared, matte)
        if not self.accumulated:
            return _with_coverage(now.paint, now.coverage)
        past = [before for _, before in self._previous(analysis)]
        with self.clock("accumulate"):
            picture = _with_coverage(accumulate(now, past), accumulated_coverage(now, past))
        self._keep(analysis, now)
        return picture

    def load_previous(self, analysis: StrokeAnalysis, shared: bool = False, matte: AnyArray | None = None) -> None:
        """Paint a previous frame for accumulation only; `shared`: the run of that frame paints it, too."""
        if self.accumulated:
            self._keep(analysis, self._painted(analysis, shared, matte))

    def _painted(self, analysis: StrokeAnalysis, shared: bool, matte: AnyArray | None) -> Painting:
        shares = shared and self.opaque and not self.traced
        return self._shared_painting(analysis) if shares else self._painting(analysis, matte)

    def _shared_painting(self, analysis: StrokeAnalysis) -> Painting:
        """The painting of a frame that two runs need: made by one of them, or made here and left for the other one."""
        origin = self.params, self.size, self.seed, analysis.number, self.deep
        found = SHARED.take(origin, analysis)
        if found is None:
            found = self._painting(analysis)
            SHARED.put(origin, analysis, found)
        return found

    def state(self) -> State:
        """Analyses of the previous frames as arrays by name."""
        return flatten({str(index): analysis.pack() for index, (analysis, _) in enumerate(self.past)})

    def restore(self, state: Arrays) -> None:
        self.past = []
        count = len({name.partition(".")[0] for name in state})
        for index in reversed(range(count)):
            self.load_previous(unpack(part(state, str(index))))

    def _previous(self, analysis: StrokeAnalysis) -> list[tuple[StrokeAnalysis, Painting]]:
        """Paintings of the frames directly before, latest first."""
        follows = bool(self.past) and self.past[0][0].number == analysis.number - 1 and analysis.back is not None
        return self.past if follows else []

    def _keep(self, analysis: StrokeAnalysis, now: Painting) -> None:
        self.past = [(analysis, now), *self._previous(analysis)][: self.accumulated]

    def _painting(self, analysis: StrokeAnalysis, matte: AnyArray | None = None) -> Painting:
        with self.clock("ground"):
            width, height = self.size
            direction = analysis.direction(self.size, self.buffers.get("direction", (height, width, 2)))
            ground = self._ground(analysis)
        coverage = None
        if self.params.renderer == "explicit":
            canvas = self._explicit(analysis, direction, ground)
        else:
            canvas, coverage = self._implicit(analysis, direction, ground, matte)
        with self.clock("light"):
            _round_off(canvas)
            strength, gloss, weave = (analysis.pixel_field(name, self.size) for name in ("light", "gloss", "weave"))
            lit = emboss(canvas, Lighting(strength=strength, gloss=gloss, weave_px=weave), self.deep)
        attention = None if analysis.attention is None else np.asarray(to_single(analysis.attention), np.float32)
        paint = self._on_paper(lit, analysis)
        return Painting(paint, analysis.picture, analysis.backward_flow(), attention, coverage)

    def _on_paper(self, lit: Painted, analysis: StrokeAnalysis) -> Painted:
        if analysis.rims is None:
            return lit
        with self.clock("paper"):
            grain = np.multiply(analysis.pixel_field("paper", self.size), PAINTER.paper_grain)
            return settle_pigment(lit, analysis.rim_darkness(self.size), grain)

    def _order(self, layer: StrokeLayer) -> NDArray[np.intp]:
        """Painting order of a layer, topmost first."""
        return colour_order(layer.values("colour")) if self.params.stroke_order == "colour" else layer.topmost_first

    def _options(
        self, analysis: StrokeAnalysis, layer: StrokeLayer, tangents: NDArray[np.float32] | None = None
    ) -> RasterOptions:
        return RasterOptions(
            self.seed, layer.profile, self._guide(analysis, layer), layer.values("tolerance"), self.threads,
            tangents, None if self.traces is None else self.traces.owners,
        )  # fmt: skip

    def _implicit(
        self, analysis: StrokeAnalysis, direction: Direction, ground: Plane, matte: AnyArray | None
    ) -> tuple[Canvas, Plane | None]:
        """Front to back: from the finest layer down to the ground. Also returns the coverage, float32 (h, w), if the
        painter is not opaque."""
        if self.scratch is None:
            self.scratch = empty_buffer(ground.shape), np.empty((*ground.shape[:2], 4), np.float32)
        buffer, canvas = self.scratch
        clear(buffer)
        tangents = unit_tangents(direction, self.buffers.get("tangents", direction.shape))
        self.traces = Traces.of(self.size) if self.traced else None
        for index in reversed(range(len(analysis.layers))):
            layer = analysis.layers[index]
            with self.clock(f"layer {index + 1}"):
                presence = layer.values("presence")
                strokes = fade(layer.dots(), presence if matte is None else presence * _inside(layer.xy, matte))
                options = self._options(analysis, layer, tangents)
                streamlines_forward(buffer, strokes, direction, layer.values("length_px"), self._order(layer), options)
            if self.traces is not None:
                self.traces.add(index, buffer.paint[..., TRANSMITTANCE])
        if self.opaque:
            return composite_over(buffer, ground, canvas), None
        coverage = 1 - buffer.paint[..., TRANSMITTANCE]
        known = coverage > _LEAST_COVERAGE
        np.divide(buffer.paint[..., :3], coverage[..., None], out=ground, where=known[..., None])
        return composite_over(buffer, ground, canvas), np.where(known, coverage, 0).astype(np.float32)

    def _explicit(self, analysis: StrokeAnalysis, direction: Direction, ground: Plane) -> Canvas:
        """Back to front: strokes end where the picture's colour changes."""
        canvas = self._canvas(analysis, ground)
        self.traces = Traces.of(self.size) if self.traced else None
        for index, layer in enumerate(analysis.layers):
            edge = float(np.median(layer.values("tolerance"))) if len(layer) else 0.0
            with self.clock(f"layer {index + 1}"):
                dots, guide = fade(layer.dots(), layer.values("presence")), self._guide(analysis, layer)
                rules = TraceRules(guide, canvas if index else None, edge)
                strokes = trace_from(dots, layer.values("length_px"), direction, rules)
                trace = StrokeTrace(self.traces.owners, np.zeros(ground.shape[:2], np.float32)) if self.traces else None
                paint(canvas, strokes, seed=self.seed, profile=layer.profile, guide=guide, tolerance=edge, trace=trace)
            if self.traces is not None and trace is not None:
                self.traces.lay_over(index, trace.cover)
        return canvas

    def _canvas(self, analysis: StrokeAnalysis, ground: Plane) -> Canvas:
        """The ground, whose target colour is the picture."""
        canvas = np.zeros((*ground.shape[:2], 7), np.float32)
        canvas[..., :3] = ground
        canvas[..., TARGET:] = _upscaled(analysis.picture, self.size)
        return canvas

    def _guide(self, analysis: StrokeAnalysis, layer: StrokeLayer) -> Frame:
        return _upscaled(_blurred(analysis.picture, layer.sigma_px), self.size)

    def _ground(self, analysis: StrokeAnalysis) -> Plane:
        """The ground, float32 (h, w, 3): a broad blur of the picture under a veil of the ground colour."""
        size = (analysis.picture.shape[1], analysis.picture.shape[0])

        def field(name: str) -> StyleField:
            return analysis.pixel_field(name, size)

        broad = _blurred(analysis.picture, analysis.layers[0].sigma_px * 2)
        vivid, contrast = (value if isinstance(value, float) else value.ravel() for value in map(field, _PAINT))
        colours = pigment(broad.reshape(-1, 3).astype(np.float32), vivid, contrast).reshape(broad.shape)
        cover = np.asarray(field("cover"), np.float32)
        if cover.any():
            veil = np.empty_like(colours)
            for c, name in enumerate(("ground_red", "ground_green", "ground_blue")):
                veil[..., c] = cover * (np.asarray(field(name), np.float32) - colours[..., c])
            veil /= 1 + np.abs(veil) * np.float32(1 / PAINTER.cover_limit)
            colours += veil
        out = self.buffers.get("ground", (self.size[1], self.size[0], 3))
        return np.asarray(cv2.resize(colours, self.size, dst=out, interpolation=cv2.INTER_LINEAR), np.float32)


_PAINT = ("vivid", "contrast")
_LEAST_COVERAGE = 1 / 512
"""Coverage below which a pixel has no paint, so that its colour is not divided by next to nothing."""


def _inside(xy: NDArray[np.float32], matte: AnyArray) -> NDArray[np.float32]:
    """The opacity, 0..1, of the matte at the places of strokes, float32 (n,)."""
    x, y = (np.clip(np.rint(xy[:, c]).astype(np.intp), 0, matte.shape[1 - c] - 1) for c in (0, 1))
    return np.asarray(matte[y, x, 0] / np.float32(white_of(matte)), np.float32)


def _with_coverage(paint: Painted, coverage: Plane | None) -> AnyArray:
    return paint if coverage is None else with_opacity(paint, as_uint16(coverage))


def colour_order(colours: NDArray[np.float32]) -> NDArray[np.intp]:
    """Sort RGB colours (n, 3) by R^2 + G^2 + B^2, then G, then R, then B; return indices, smallest first.

    Source: kagaya2011video, eq. 5. The sort is stable.
    """
    whole = np.rint(colours).astype(np.int64)
    return np.lexsort((whole[:, 2], whole[:, 0], whole[:, 1], (whole * whole).sum(axis=1)))


def _round_off(canvas: Canvas) -> None:
    """Blur the paint height, in place."""
    sigma = PAINTER.rounding * min(canvas.shape[:2])
    if sigma > PAINTER.least_rounding_px:
        canvas[..., HEIGHT] = cv2.GaussianBlur(np.ascontiguousarray(canvas[..., HEIGHT]), (0, 0), sigma)


def _upscaled(image: AnyArray, size: tuple[int, int]) -> AnyArray:
    if (image.shape[1], image.shape[0]) == size:
        return image
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR))


def _blurred(picture: Frame, sigma_px: float) -> Frame:
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), sigma_px), np.uint8) if sigma_px > 0.3 else picture

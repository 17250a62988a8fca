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
from pipeline.strokes.accumulation import Painting, accumulate
from pipeline.strokes.brush import HEIGHT, TARGET, Canvas, Direction
from pipeline.strokes.emboss import Lighting, emboss
from pipeline.strokes.paper import settle_pigment
from pipeline.strokes.raster import paint
from pipeline.strokes.seeds import StyleField
from pipeline.strokes.streamlines_forward import (
    FrontToBack,
    RasterOptions,
    clear,
    composite_over,
    empty_buffer,
    streamlines_forward,
)
from pipeline.strokes.trace import TraceRules, trace_from, unit_tangents
from pipeline.strokes.tracks import fade


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


class Painter:
    """Paints consecutive frames of one size. Not thread-safe.

    The only state is the previous paintings. A painter that gets the previous analyses (`load_previous`) continues
    with the same bytes.

    Args:
        size: (width, height), px.
        seed: random seed.
        threads: bands of rows that the implicit renderers paint concurrently; the bytes are the same.
    """

    def __init__(
        self, params: MultistyleParams, size: tuple[int, int], seed: int, clock: Clock = no_clock, threads: int = 1
    ) -> None:  # fmt: skip
        self.params, self.size, self.seed, self.clock, self.threads = params, size, seed, clock, threads
        self.accumulated = accumulated_frames(params)
        self.past: list[tuple[StrokeAnalysis, Painting]] = []
        self.scratch: tuple[FrontToBack, Canvas] | None = None  # kept from frame to frame: new memory must be paged in
        self.buffers = Buffers()

    def paint(self, analysis: StrokeAnalysis, shared: bool = False) -> Frame:
        """Paint a frame: uint8 (h, w, 3).

        Args:
            shared: whether the next run of frames recalls this frame, perhaps in another thread of this process.
        """
        now = self._shared_painting(analysis) if shared else self._painting(analysis)
        if not self.accumulated:
            return now.paint
        with self.clock("accumulate"):
            picture = accumulate(now, [before for _, before in self._previous(analysis)])
        self._keep(analysis, now)
        return picture

    def load_previous(self, analysis: StrokeAnalysis, shared: bool = False) -> None:
        """Paint a previous frame for accumulation only; `shared`: the run of that frame paints it, too."""
        if self.accumulated:
            self._keep(analysis, self._shared_painting(analysis) if shared else self._painting(analysis))

    def _shared_painting(self, analysis: StrokeAnalysis) -> Painting:
        """The painting of a frame that two runs need: made by one of them, or made here and left for the other one."""
        origin = self.params, self.size, self.seed, analysis.number
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

    def _painting(self, analysis: StrokeAnalysis) -> Painting:
        with self.clock("ground"):
            width, height = self.size
            direction = analysis.direction(self.size, self.buffers.get("direction", (height, width, 2)))
            ground = self._ground(analysis)
        layers = self._explicit if self.params.renderer == "explicit" else self._implicit
        canvas = layers(analysis, direction, ground)
        with self.clock("light"):
            _round_off(canvas)
            strength, gloss, weave = (analysis.pixel_field(name, self.size) for name in ("light", "gloss", "weave"))
            lit = emboss(canvas, Lighting(strength=strength, gloss=gloss, weave_px=weave))
        attention = None if analysis.attention is None else np.asarray(to_single(analysis.attention), np.float32)
        return Painting(self._on_paper(lit, analysis), analysis.picture, analysis.backward_flow(), attention)

    def _on_paper(self, lit: Frame, analysis: StrokeAnalysis) -> Frame:
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
            tangents,
        )  # fmt: skip

    def _implicit(self, analysis: StrokeAnalysis, direction: Direction, ground: Plane) -> Canvas:
        """Front to back: from the finest layer down to the ground."""
        if self.scratch is None:
            self.scratch = empty_buffer(ground.shape), np.empty((*ground.shape[:2], 4), np.float32)
        buffer, canvas = self.scratch
        clear(buffer)
        tangents = unit_tangents(direction, self.buffers.get("tangents", direction.shape))
        for index in reversed(range(len(analysis.layers))):
            layer = analysis.layers[index]
            with self.clock(f"layer {index + 1}"):
                strokes = fade(layer.dots(), layer.values("presence"))
                options = self._options(analysis, layer, tangents)
                streamlines_forward(buffer, strokes, direction, layer.values("length_px"), self._order(layer), options)
        return composite_over(buffer, ground, canvas)

    def _explicit(self, analysis: StrokeAnalysis, direction: Direction, ground: Plane) -> Canvas:
        """Back to front: strokes end where the picture's colour changes."""
        canvas = self._canvas(analysis, ground)
        for index, layer in enumerate(analysis.layers):
            edge = float(np.median(layer.values("tolerance"))) if len(layer) else 0.0
            with self.clock(f"layer {index + 1}"):
                dots, guide = fade(layer.dots(), layer.values("presence")), self._guide(analysis, layer)
                rules = TraceRules(guide, canvas if index else None, edge)
                strokes = trace_from(dots, layer.values("length_px"), direction, rules)
                paint(canvas, strokes, seed=self.seed, profile=layer.profile, guide=guide, tolerance=edge)
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

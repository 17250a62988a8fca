"""Links between the frames of a window: optical flow, its reliability, and their storage for later steps."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.flow.reliability import inside
from pipeline.flow.warp import fetch
from pipeline.frames import Flow, Frame, Plane
from pipeline.methods.base import TaskContext
from pipeline.methods.patches.params import PatchesParams

LEAST_GRADIENT = 1.0
"""Root mean square of the gradient, gray levels per working px, above which a pixel counts as textured."""


@dataclass(frozen=True)
class Pair:
    """Links between frames i and j = i + gap.

    Attributes:
        ahead, back: float32 (h, w, 2), flow from i to j and from j to i, working px.
        there, home: float32 (h, w), 0..1, reliability of `ahead` and of `back`.
    """

    ahead: Flow
    back: Flow
    there: Plane
    home: Plane


def reliability(here: Frame, there: Frame, flow: Flow, back: Flow, colour_scale: float) -> Plane:
    """Reliability R_xy = exp(-|c_x - c_y|) of the links between pixels x and y: float32 (h, w), 0..1.

    Args:
        here, there: uint8 (h, w, 3).
        flow, back: flow from `here` to `there` and from `there` to `here`, px.
        colour_scale: unit of the RGB distance, gray levels.

    Source: zhang2011patches, section 4. Departures: the paper does not give the unit of colours; with 0..255 every R
    is about 0, with 0..1 hardly any is below 0.2. Links that fail the forward-backward check get R = 0, since occluded
    pixels have no partner, and links that pass it only approximately get half of R. Colours are blurred by about a
    pixel to suppress noise.
    """
    a, b = (cv2.GaussianBlur(f, (0, 0), 0.8).astype(np.float32) for f in (here, there))
    distance = norm(a - fetch(b, flow))
    return np.asarray(np.exp(-distance / np.float32(colour_scale)) * _leads_back(flow, back), np.float32)


def norm(vectors: NDArray[Any]) -> Plane:
    """Euclidean norm over the last axis: float32 (h, w). Faster than `np.linalg.norm` for 2 or 3 components."""
    square = vectors[..., 0] * vectors[..., 0]
    for channel in range(1, vectors.shape[-1]):
        square += vectors[..., channel] * vectors[..., channel]
    return np.asarray(np.sqrt(square), np.float32)


def _leads_back(flow: Flow, back: Flow) -> Plane:
    """Forward-backward check: 1 = passed, 0.5 = passed approximately (usual in smooth areas), 0 = failed."""
    there = fetch(back, flow)
    squares = np.square(flow) + np.square(there)
    trip, length = np.square(flow + there), squares[..., 0] + squares[..., 1]
    error = trip[..., 0] + trip[..., 1]
    sure, near = error <= 0.01 * length + 0.5, error <= 0.04 * length + 2.5
    return np.asarray((sure.astype(np.float32) + near) * np.float32(0.5) * inside(flow), np.float32)


def textured(small: Frame) -> NDArray[np.bool_]:
    """Pixels with enough texture for reliable motion: bool (h, w).

    Flow in smooth areas is interpolated from elsewhere or follows noise, so it is no evidence for clustering.
    """
    gray = cv2.GaussianBlur(cv2.cvtColor(small, cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), 1.0)
    dx = cv2.Scharr(gray, cv2.CV_32F, 1, 0, scale=1 / 32)
    dy = cv2.Scharr(gray, cv2.CV_32F, 0, 1, scale=1 / 32)
    return np.asarray(cv2.blur(dx * dx + dy * dy, (7, 7)) > LEAST_GRADIENT**2)


def pack(pair: Pair, index: int, gap: int) -> dict[str, NDArray[Any]]:
    """Arrays for an artefact: flow in half precision (1/64 px at 32 px and finer below), reliability in 255 steps.

    `ahead` is kept for neighbours only: over a gap only `back` is followed.
    """
    half, bytes_ = {"b": pair.back}, {"h": pair.home}
    if gap == 1:
        half["f"], bytes_["t"] = pair.ahead, pair.there
    return {f"{k}-{index}-{gap}": np.clip(v, -6e4, 6e4).astype(np.float16) for k, v in half.items()} | {
        f"{k}-{index}-{gap}": np.rint(v * 255).astype(np.uint8) for k, v in bytes_.items()
    }


MOST_PAIRS = 10
"""Number of decoded flow fields held in memory: about those of one frame's window."""


def artefact_of(index: int, gap: int, begin: int, run: int) -> str:
    """Name of the artefact with the flow from frame `index + gap` back to `index`.

    Gap 0 stands for the small frame and the forward flow. Arrays that are read together are stored together:

    flow-<run>   small frames, forward flow, and backward flow between neighbours; read by every step
    far-<run>    backward flow over larger gaps within the run; read mainly for clustering
    over-<run>   backward flow from the next run into this run
    """
    start, last = (begin + (frame - begin) // run * run for frame in (index, index + gap))
    return f"{'over' if last > start else 'far' if gap > 1 else 'flow'}-{start:07d}"


class Links:
    """Reads the artefacts of the tasks "flow-...", holding at most `most` artefacts in memory."""

    def __init__(self, context: TaskContext[PatchesParams], begin: int, run: int, most: int = 6) -> None:
        self._context, self._begin, self._run, self._most = context, begin, run, most
        self._held: OrderedDict[str, dict[str, NDArray[Any]]] = OrderedDict()
        self._pairs: OrderedDict[str, tuple[Flow, Plane] | None] = OrderedDict()

    def _get(self, name: str, index: int, gap: int) -> NDArray[Any] | None:
        if index < self._begin:
            return None
        where = artefact_of(index, gap, self._begin, self._run)
        if where not in self._held:
            self._held[where] = self._context.load("cluster", where)
            while len(self._held) > self._most:
                self._held.popitem(last=False)
        self._held.move_to_end(where)
        return self._held[where].get(name)

    def small(self, index: int) -> Frame:
        """Frame `index` at the working size."""
        found = self._get(f"small-{index}", index, 0)
        assert found is not None
        return found

    def back(self, index: int, gap: int = 1) -> tuple[Flow, Plane] | None:
        """Flow from frame `index` to `index - gap` and its reliability; None if that is outside the shot."""
        return self._pair("b", "h", index - gap, gap)

    def ahead(self, index: int) -> tuple[Flow, Plane] | None:
        """Flow from frame `index` to the next and its reliability; None at the end of the shot."""
        return self._pair("f", "t", index, 1)

    def _pair(self, flow: str, trust: str, index: int, gap: int) -> tuple[Flow, Plane] | None:
        name = f"{flow}-{index}-{gap}"
        if name not in self._pairs:
            self._pairs[name] = self._read(name, f"{trust}-{index}-{gap}", index, gap)
            while len(self._pairs) > MOST_PAIRS:
                self._pairs.popitem(last=False)
        return self._pairs[name]

    def _read(self, flow: str, trust: str, index: int, gap: int) -> tuple[Flow, Plane] | None:
        at = 0 if flow.startswith("f") else gap
        found, reliable = self._get(flow, index, at), self._get(trust, index, at)
        if found is None or reliable is None:
            return None
        pair = found.astype(np.float32), reliable.astype(np.float32) / np.float32(255)
        for array in pair:
            array.setflags(write=False)
        return pair

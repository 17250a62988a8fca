"""Passes of painted frames: motion, clusters, and the place in the painting of a patch that each pixel shows."""

from __future__ import annotations

import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.arrays import State
from pipeline.frames import Flow, Frame, Plane
from pipeline.methods.base import MadePass, TaskContext
from pipeline.methods.patches.clustering import LabelMaps
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.window_flow import WindowFlow
from pipeline.passes.made import FLOW
from pipeline.regions.mattes import LabelMattes

STROKE_IDS = "stroke-ids"
MADE = (
    FLOW,
    MadePass("labels", "Cluster of each pixel, as in the artefact labels: 0 = unclustered, 1 = background.", ("ID",),
             ids=True),
    MadePass("matte", "Share of the pixel that painted patches show, 0..1; the rest is painted anew in each frame.",
             ("Y",)),
    MadePass("patches", "The patch that a pixel shows most, by its number; 0 = none.", ("ID",),
             ids=True),
    MadePass("positions", "The place in the painting of that patch that the pixel shows; -1 = none.", ("X", "Y"), "px",
             png_scale=8.0),
    MadePass(STROKE_IDS, "The stroke of that patch that the pixel shows; 0 = the ground, or painted anew each frame.",
             ("ID",), ids=True),
)  # fmt: skip
OF_PAINTING = ("matte", "patches", "positions", STROKE_IDS)


@dataclass(frozen=True)
class PatchTrace:
    """The passes of a frame: the painting patches that it shows.

    Attributes:
        weight: float32 (h, w), largest weight of a patch so far.
        patches: uint32 (h, w), number of that patch; 0: none.
        positions: float32 (h, w, 2), place in its painting, px.
        stroke_ids: uint32 (h, w), number of the stroke there; 0: none.
        matte: float32 (h, w), share of all patches.
    """

    weight: Plane
    patches: NDArray[np.uint32]
    positions: NDArray[np.float32]
    stroke_ids: NDArray[np.uint32]
    matte: Plane

    @classmethod
    def of(cls, size: tuple[int, int]) -> PatchTrace:
        """Nothing yet, for frames of (width, height) px."""
        shape = size[::-1]
        none = np.full((*shape, 2), -1, np.float32)
        zeros, whole = np.zeros(shape, np.float32), np.zeros(shape, np.uint32)
        return cls(zeros, whole, none, whole.copy(), zeros.copy())

    def add(
        self, patch: str, box: tuple[slice, slice], weight: Plane, positions: tuple[Plane, Plane],
        strokes: NDArray[np.uint32],
    ) -> None:  # fmt: skip
        """Add a patch, by its key, in a part of the frame: its weight, positions x and y in its painting, and numbers
        of the strokes there."""
        most = weight > self.weight[box]
        self.weight[box][most] = weight[most]
        self.patches[box][most] = zlib.crc32(patch.encode())
        self.stroke_ids[box][most] = strokes[most]
        for k, plane in enumerate(positions):
            self.positions[box][..., k][most] = plane[most]

    def finish(self, covered: Plane, opacity: Plane) -> None:
        """Set the matte: `covered`, sum of the weights of patches; `opacity` of the layer over them."""
        self.matte[:] = np.where(covered > 0, 1 - opacity, 0)
        self.stroke_ids[self.matte < np.float32(0.5)] = 0


class FramePasses:
    """Emits the wanted passes of the frames of a run.

    Args:
        begin: first frame of the shot.
    """

    def __init__(self, context: TaskContext[PatchesParams], begin: int) -> None:
        clustered = context.params.temporal == "on"
        self._context = context
        self.wanted = [made.name for made in MADE if clustered and context.wants_pass(made.name)]
        self._maps, self._flow = LabelMaps(context, begin), WindowFlow(context, begin)

    @property
    def traces(self) -> bool:
        """Whether a `PatchTrace` is needed."""
        return bool(set(OF_PAINTING) & set(self.wanted))

    def emit(self, index: int, frame: Frame, trace: PatchTrace | None) -> None:
        """Emit the passes of a frame; `trace`: of the painting that it shows."""
        if not self.wanted:
            return
        made: State = {}
        if "flow" in self.wanted:
            made["flow"] = self._motion(index)
        if "labels" in self.wanted:
            made["labels"] = LabelMattes(self._maps.require(index), frame).full()
        if trace is not None:
            made |= {name: getattr(trace, name.replace("-", "_")) for name in OF_PAINTING if name in self.wanted}
        self._context.emit_passes(index, made)

    def _motion(self, index: int) -> Flow:
        shape = self._maps.require(index).shape
        found = self._flow.backward(index)
        if found is None:
            return np.zeros((*shape, 2), np.float32)
        flow = found[0]
        return flow * np.divide(self._context.size, flow.shape[1::-1]).astype(np.float32)

"""Lines along the edges' directions, with directions that hold still."""

from __future__ import annotations

import cv2
import numpy as np

from pipeline.arrays import Arrays, State
from pipeline.compute import Device, device
from pipeline.errors import DeviceError
from pipeline.frames import Flow, Plane
from pipeline.lines.coherent import follow
from pipeline.lines.dog import dog_response
from pipeline.lines.fdog import fdog_response
from pipeline.tensors.structure import Tensors, structure_tensor, tangent_field

TENSOR = 2.0
"""Standard deviation of the tensors' smoothing over the narrow Gaussian's: a line and its two sides agree."""
ALONG = 2.5
"""Standard deviation along the line over the narrow Gaussian's; kang2007coherent's 3 costs more and shows no more."""


class FlowLines:
    """Flow-based difference of Gaussians, frame after frame: structure tensors keep a memory along the motion.

    Averaging along lines wipes out dots, and an eye is little more: so where importance is high, the plain difference
    of Gaussians may add to it.

    Runs on this process's compute device; where there is none, in NumPy: many times slower, and the same bytes.

    Args:
        sigma_px: of the narrow Gaussian across a line, px of the pictures given.
        tau: weight of the wider one.
        memory: weight of the past in the tensors, 0..1.
        shrink: full size, which the flow has, over the pictures' size.
    """

    def __init__(self, sigma_px: float, tau: float, memory: float, shrink: int) -> None:
        self.sigma_px, self.tau, self.memory, self.shrink = sigma_px, tau, memory, shrink
        self.tensors: Tensors | None = None
        self.device = _device()

    def step(self, gray: Plane, importance: Plane, flow: Flow | None) -> Plane:
        """Response to the next frame, float32 (h, w), gray levels: positive on the dark side of an edge.

        Args:
            gray: float32 (h, w), gray levels.
            importance: float32 (h, w), 0..1.
            flow: from the previous frame, px of the full size; None = nothing is known of the past.
        """
        tensors = structure_tensor(gray, TENSOR * self.sigma_px)
        if flow is not None and self.tensors is not None:
            self._remember(tensors, self.tensors, flow)
        self.tensors = tensors
        tangent = tangent_field(tensors)
        lines = fdog_response(gray, tangent, self.sigma_px, self.tau, ALONG * self.sigma_px, self.device)
        dots = np.maximum(dog_response(gray, self.sigma_px, self.tau) - lines, 0)
        return np.asarray(lines + importance * importance * dots, np.float32)

    def _remember(self, tensors: Tensors, before: Tensors, flow: Flow) -> None:
        moved = self._shrink(flow, (tensors.shape[2], tensors.shape[1]))
        for now, past in zip(tensors, before, strict=True):
            change = follow(past, moved)
            change -= now
            change *= np.float32(self.memory)
            now += change

    def _shrink(self, flow: Flow, size: tuple[int, int]) -> Flow:
        if self.shrink == 1:
            return flow
        return np.asarray(cv2.resize(flow, size, interpolation=cv2.INTER_NEAREST) / np.float32(self.shrink), np.float32)

    def state(self) -> State:
        return {} if self.tensors is None else {"tensors": self.tensors}

    def restore(self, state: Arrays) -> None:
        self.tensors = state.get("tensors")


def _device() -> Device | None:
    try:
        return device()
    except DeviceError:
        return None

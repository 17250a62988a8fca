"""Flow-based lines with a structure tensor that is smoothed over time."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Arrays, State
from pipeline.compute import Device, device
from pipeline.errors import DeviceError
from pipeline.frames import Flow, Plane
from pipeline.lines.coherent import warp_forward
from pipeline.lines.dog import dog_response
from pipeline.lines.fdog import fdog_response
from pipeline.tensors.structure import Tensors, structure_tensor, tangent_field

TENSOR = 2.0
"""Sigma of the tensor smoothing, in sigmas of the narrower Gaussian: a line and its two sides agree."""
ALONG = 2.5
"""Sigma along the line, in sigmas of the narrower Gaussian. With kang2007coherent's 3 the lines look the same and take
longer."""


class FlowLines:
    """Flow-based difference of Gaussians of consecutive frames. Structure tensors are averaged along the motion.

    Averaging along lines removes dots, and an eye is hardly larger than a dot. Where importance is high, the plain
    difference of Gaussians is therefore added.

    Runs on this process's compute device; without one, in NumPy, many times slower and with the same bytes.

    Args:
        sigma_px: standard deviation of the narrower Gaussian across a line, px of `gray`.
        tau: weight of the wider Gaussian.
        memory: weight of the previous frame's tensors, 0..1.
    """

    def __init__(self, sigma_px: float, tau: float, memory: float) -> None:
        self.sigma_px, self.tau, self.memory = sigma_px, tau, memory
        self.tensors: Tensors | None = None
        self.device = _device()

    def step(self, gray: Plane, importance: Plane, flow: Flow | None) -> Plane:
        """Response of the next frame, float32 (h, w), gray levels: positive on the dark side of an edge.

        Args:
            gray: float32 (h, w), gray levels.
            importance: float32 (h, w), 0..1.
            flow: from the previous frame, float32 (h, w, 2), px; None = a shot begins.
        """
        tensors = structure_tensor(gray, TENSOR * self.sigma_px)
        if flow is not None and self.tensors is not None:
            self._smooth_over_time(tensors, self.tensors, flow)
        self.tensors = tensors
        tangent = tangent_field(tensors)
        lines = fdog_response(gray, tangent, self.sigma_px, self.tau, ALONG * self.sigma_px, self.device)
        dots = np.maximum(dog_response(gray, self.sigma_px, self.tau) - lines, 0)
        return np.asarray(lines + importance * importance * dots, np.float32)

    def _smooth_over_time(self, tensors: Tensors, before: Tensors, flow: Flow) -> None:
        for now, past in zip(tensors, before, strict=True):
            change = warp_forward(past, flow)
            change -= now
            change *= np.float32(self.memory)
            now += change

    def state(self) -> State:
        return {} if self.tensors is None else {"tensors": self.tensors}

    def restore(self, state: Arrays) -> None:
        self.tensors = state.get("tensors")


def _device() -> Device | None:
    try:
        return device()
    except DeviceError:
        return None

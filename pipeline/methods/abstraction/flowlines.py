"""Lines along the edges' directions, with directions that hold still."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pipeline.compute import Device, device
from pipeline.errors import DeviceError
from pipeline.frames import Flow, Plane
from pipeline.lines.coherent import follow
from pipeline.lines.fdog import fdog_response
from pipeline.tensors.structure import Tensors, structure_tensor, tangent_field

TENSOR = 2.0
"""Standard deviation of the tensors' smoothing over the narrow Gaussian's: a line and its two sides agree."""
ALONG = 3.0
"""Standard deviation along the line over the narrow Gaussian's: kang2007coherent's default."""


class FlowLines:
    """Flow-based difference of Gaussians, frame after frame: structure tensors keep a memory along the motion.

    Runs on this process's compute device; where there is none, in NumPy, many times slower and with the same bytes.

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

    def step(self, gray: Plane, flow: Flow | None) -> Plane:
        """Response to the next frame, float32 (h, w): see `fdog_response`.

        Args:
            gray: float32 (h, w), gray levels.
            flow: from the previous frame, px of the full size; None = nothing is known of the past.
        """
        tensors = structure_tensor(gray, TENSOR * self.sigma_px)
        if flow is not None and self.tensors is not None:
            self._remember(tensors, self.tensors, self._shrink(flow))
        self.tensors = tensors
        tangent = tangent_field(tensors)
        return fdog_response(gray, tangent, self.sigma_px, self.tau, ALONG * self.sigma_px, self.device)

    def _remember(self, tensors: Tensors, before: Tensors, flow: Flow) -> None:
        for now, past in zip(tensors, before, strict=True):
            cv2.addWeighted(follow(past, flow), self.memory, now, 1 - self.memory, 0, dst=now)

    def _shrink(self, flow: Flow) -> Flow:
        if self.shrink == 1:
            return flow
        size = self.tensors.shape[2], self.tensors.shape[1]
        small = cv2.resize(flow, size, interpolation=cv2.INTER_NEAREST)
        return np.asarray(small / np.float32(self.shrink), np.float32)

    def state(self) -> dict[str, NDArray[Any]]:
        return {} if self.tensors is None else {"tensors": self.tensors}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        self.tensors = state.get("tensors")


def _device() -> Device | None:
    try:
        return device()
    except DeviceError:
        return None

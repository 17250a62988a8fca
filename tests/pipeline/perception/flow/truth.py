"""Pictures whose flow is known."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pipeline.frames import Flow, Frame, Mask
from pipeline.scenes import scene
from tests.conftest import MEDIA


@dataclass(frozen=True)
class Truth:
    previous: Frame
    current: Frame
    flow: Flow
    known: Mask
    """Pixels whose flow is known and whose end point is visible."""

    def error_px(self, flow: Flow) -> float:
        """Mean end-point error."""
        return float(np.linalg.norm(flow - self.flow, axis=-1)[self.known].mean())

    def crop(self, rows: slice, columns: slice) -> Truth:
        cut = (rows, columns)
        return Truth(*(np.ascontiguousarray(a[cut]) for a in (self.previous, self.current, self.flow, self.known)))


def rubber_whale() -> Truth:
    folder = MEDIA / "flow" / "middlebury_RubberWhale"
    flow = read_flo(folder / "flow10.flo")
    return Truth(read(folder / "frame10.png"), read(folder / "frame11.png"), flow, (np.abs(flow) < 1e9).all(-1))


def alley() -> Truth:
    folder = MEDIA / "flow" / "sintel_alley_1"
    flow = read_flo(folder / "flow_0002.flo")
    return Truth(read(folder / "clean_0002.png"), read(folder / "clean_0003.png"), flow, np.ones(flow.shape[:2], bool))


def of_scene(name: str, size: tuple[int, int] = (192, 108)) -> Truth:
    made = scene(name, size, 6, 24.0)
    here = made.frame(3)
    return Truth(here.image, made.image(4), here.velocity_next, ~here.occluded_next)


def read(file: Path) -> Frame:
    return cv2.cvtColor(cv2.imread(str(file)), cv2.COLOR_BGR2RGB)


def read_flo(file: Path) -> Flow:
    """Middlebury's format: the tag PIEH, width, height, then (dx, dy) row by row, little endian."""
    data = file.read_bytes()
    assert data[:4] == b"PIEH"
    width, height = np.frombuffer(data, "<i4", 2, 4)
    return np.frombuffer(data, "<f4", offset=12).reshape(height, width, 2).copy()

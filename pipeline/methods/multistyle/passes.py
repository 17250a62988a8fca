"""Passes of the method, and those of the analysis of a frame."""

from __future__ import annotations

import numpy as np

from pipeline.arrays import Arrays
from pipeline.methods.base import MadePass
from pipeline.methods.multistyle.analyzer import Observation
from pipeline.methods.multistyle.painter import TRACED_LAYERS
from pipeline.passes.made import FLOW, PNG_MIDDLE

MADE = (
    FLOW,
    MadePass(
        "orientation", "Direction of the strokes as a unit vector, y down; it and its opposite are the same direction.",
        ("X", "Y"), png_zero=PNG_MIDDLE, png_scale=PNG_MIDDLE - 1,
    ),
    MadePass(
        "regions", "Region of the design of each pixel: its number in the artefact regions.", ("ID",), ids=True
    ),
    MadePass("tubes", "Tube of each pixel: a segment followed through the shot; 0 = none.", ("ID",), ids=True),
    MadePass(
        "stroke-ids", "The stroke that a pixel shows most: a stroke keeps its number for its life; 0 = the ground.",
        ("ID",), ids=True,
    ),
    MadePass(
        "layers", "Share of the pixel that shows each layer of strokes, 0..1, from coarse to fine.",
        tuple(f"L{number + 1}" for number in range(TRACED_LAYERS)),
    ),
)  # fmt: skip
OF_REGIONS = ("regions", "tubes")


def observed_passes(seen: Observation) -> Arrays:
    """Flow and orientation of a frame, by name, at the sizes at which they were found."""
    if seen.motion is None:
        flow = np.zeros((*seen.picture.shape[:2], 2), np.float32)
    else:
        back = seen.motion.back
        flow = back * np.divide(seen.frame.shape[1::-1], back.shape[1::-1]).astype(np.float32)
    angle = np.arctan2(seen.field[1], seen.field[0]) / 2
    return {"flow": flow, "orientation": np.dstack([np.cos(angle), np.sin(angle)])}

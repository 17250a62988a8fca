"""Every parameter of the abstraction method, with unit, range and the paper's symbol."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Literal

from pydantic import Field

from pipeline.methods.base import Alternatives, Params, When
from pipeline.methods.fields import (
    Colour,
    FlowName,
    RemovedValues,
    Switch,
    choice,
    colour,
    colours,
    number,
    preroll,
    varying,
)

PRINTED: Mapping[str, Any] = {
    "core_tolerance": 1e6, "smallest_region": 0.0, "merge_similar": 0.0, "edges": "soft", "analysis": "full",
    "contrast_adaptation": 0.0, "steadiness": 0.0, "stillness": 0.0, "boundary_margin": 0.0, "paint_memory": 0.0,
    "colour_half_life": 0.0, "saliency_importance": 0.0, "motion_importance": 0.0, "importance_half_life": 0.0,
    "line_length": 0.0,
}  # fmt: skip
"""Values with `algorithm=printed` of the parameters that belong to departures from the paper."""
_OF_LINES = ("line_width", "line_threshold", "line_sharpness", "line_colour", "line_opacity")
_OF_COLOURS = ("mean_shift_steps", "hue_neighbourhood", "keep_brightness")
_OF_TIME = (
    "steadiness", "boundary_margin", "paint_memory", "colour_half_life", "importance_half_life", "motion_importance",
)  # fmt: skip
_EXTENDED, _TIME = {"algorithm": ("extended",)}, {"temporal": ("on",)}
MOST_COLOURS = 32
"""Colours of a palette."""


class AbstractionParams(Params):
    """Parameters of online video stream abstraction (zhang2011online)."""

    removed_values: ClassVar[RemovedValues] = {
        "lines": {"flow": 'Use "dog": its lines are traced along the edges now, joined and straightened.'},
    }
    applies_when: ClassVar[Mapping[str, Alternatives]] = {
        **dict.fromkeys(PRINTED, (When(params=_EXTENDED),)),
        **dict.fromkeys(_OF_TIME, (When(params=_TIME | _EXTENDED),)),
        "flow_error_limit": (When(params=_TIME),),
        "flow": (When(params=_TIME, without_passes=("motion",)),),
        "stillness": (When(params=_TIME | _EXTENDED, without_passes=("motion",)),),
        **dict.fromkeys(_OF_LINES, (When(params={"lines": ("dog",)}),)),
        "line_length": (When(params={"lines": ("dog",)} | _EXTENDED),),
        **dict.fromkeys(_OF_COLOURS, (When(inputs=("reference", "histogram")),)),
        "preroll": (When(params={"temporal": ("on",)}, way="piece"),),
    }

    # -- regions
    growing_limit: float = varying(
        20, 4, 60, "Region tolerance",
        "How far a pixel's colour may be from its region's: the 20 in 20 (1.2 - I(p)). Larger = fewer, larger regions.",
        "CIELAB", "Regions", "20",
    )  # fmt: skip
    core_tolerance: float = varying(
        0.4, 0.2, 1.5, "Core tolerance",
        "Tolerance of a new region's core, as a share of the region tolerance. Smaller = more shades in a gradient.",
        "ratio", "Regions",
    )  # fmt: skip
    smallest_region: float = varying(
        0.2, 0, 5, "Smallest region",
        "Regions under this share of the frame join a neighbour; a fifth of it where importance is 1, less "
        "where they differ strongly from all neighbours.",
        "per mille of the frame", "Regions",
    )  # fmt: skip
    merge_similar: float = varying(
        5, 0, 30, "Merge similar regions",
        "A region is merged into a larger neighbour whose mean colour differs by less than this.", "CIELAB", "Regions",
    )  # fmt: skip
    edge_threshold: float = varying(
        90, 10, 1000, "Edge threshold",
        "Upper hysteresis threshold of the edges that hold regions apart, where importance is 0.8; "
        "it varies per pixel, inversely with importance.", "gray levels", "Regions",
    )  # fmt: skip
    boundary_smoothing: float = number(
        6, 0, 20, "Boundary smoothing",
        "Radius of the low-pass filter over region boundaries; 0 = off.", "per mille of the shorter side", "Regions",
    )  # fmt: skip
    edges: Literal["auto", "soft", "sharp"] = choice(
        "auto", "Edges",
        "How region borders and lines are drawn. soft = from the low-pass filtered label map; sharp = as curves, "
        "anti-aliased by exact pixel coverage: edges of about 1.5 px at any size, and more flicker; auto = sharp from "
        "480 lines on.", "Regions",
    )  # fmt: skip

    analysis: Literal["auto", "full"] = choice(
        "auto", "Analysed size",
        "Size at which motion, regions and lines are found; they are always drawn at the frame's own. auto = half of "
        "the frame's sides from a shorter side of 720 px on, with sharp edges; full = the frame's own size: thinner "
        "regions, and twice the time.", "Regions",
    )  # fmt: skip

    contrast_adaptation: float = varying(
        1, 0, 1, "Adapt to contrast",
        "In a dim or hazy shot, smaller differences of colour make regions: weight of its contrast in their tolerances "
        "and in the edge threshold, which fall to half at most; 0 = the same in every shot, as in the paper.",
        "ratio", "Regions",
    )  # fmt: skip

    # -- time
    temporal: Switch = choice(
        "on", "Temporal coherence", "off = every frame is processed on its own, as a baseline; it flickers.", "Time"
    )
    flow: FlowName = choice(
        "dis-ultrafast", "Optical flow",
        "Motion from frame to frame: dense inverse search (fast) or TV-L1 (the paper's, OpenCL).", "Time",
    )  # fmt: skip
    flow_error_limit: float = varying(
        12, 1, 60, "Flow error limit",
        "A label is not propagated to a pixel that differs by more from its source (the paper: 5 to 20).",
        "CIELAB", "Time", "T_f",
    )  # fmt: skip
    steadiness: float = varying(
        0.85, 0, 0.95, "Steadiness",
        "Weight of the past in the input of regions and lines, where nothing moves; removes sensor noise.",
        "ratio", "Time",
    )  # fmt: skip
    stillness: float = number(
        2, 0, 20, "Stillness",
        "A pixel whose 5x5 surroundings changed by at most this is treated as still.", "gray levels", "Time",
    )  # fmt: skip
    boundary_margin: float = varying(
        7, 0, 60, "Boundary margin",
        "A boundary pixel changes region only if the other fits better by more than this.", "CIELAB", "Time",
    )  # fmt: skip
    paint_memory: float = varying(
        0.7, 0, 0.95, "Paint memory",
        "Weight of the previous output along borders, where the source agrees with its past: borders move smoothly.",
        "ratio", "Time",
    )  # fmt: skip
    colour_half_life: float = varying(
        3, 0, 60, "Colour half-life",
        "A region's colour follows the picture with this half-life, on top of eq. 4; 0 = eq. 4 alone.",
        "frames", "Time",
    )  # fmt: skip
    cut_sensitivity: float = number(
        1, 0, 3, "Cut sensitivity",
        "How readily a hard cut is detected, at which everything starts anew; 0 = never.",
        "ratio", "Time",
    )  # fmt: skip

    preroll: int = preroll(250)

    @property
    def lead_frames(self) -> int:
        return self.preroll if self.temporal == "on" else 0

    def effective(self) -> AbstractionParams:
        """These parameters; with `algorithm=printed`, those of `PRINTED` have its values, beyond their ranges, too."""
        return self.model_copy(update=PRINTED) if self.algorithm == "printed" else self

    # -- importance
    face_importance: float = number(
        1.0, 0, 1, "Faces", "Importance of faces, which get finer regions and lines.", "ratio", "Importance"
    )
    saliency_importance: float = number(
        0.4, 0, 1, "Salient things", "Importance of what stands out in a frame (spectral residual).", "ratio",
        "Importance",
    )  # fmt: skip
    motion_importance: float = number(
        0.4, 0, 1, "Moving things", "Importance of what moves against the camera.", "ratio", "Importance"
    )
    importance_half_life: float = number(
        6, 0, 60, "Importance half-life", "Importance is smoothed over past frames, so that detail does not pop.",
        "frames", "Importance",
    )  # fmt: skip

    # -- lines
    lines: Literal["dog", "off"] = choice(
        "dog", "Lines", "dog = strokes of a pen along the ridges of a difference of Gaussians; off = none.", "Lines"
    )
    line_width: float = number(
        2.6, 0.5, 10, "Line width",
        "Standard deviation of the narrower Gaussian. A line is up to 3 times as wide.",
        "per mille of the shorter side",
        "Lines", "sigma_e",
    )  # fmt: skip
    line_threshold: float = varying(
        1.1, 0, 10, "Line threshold", "Response below which nothing is drawn; lower where importance is high.",
        "gray levels", "Lines", "epsilon",
    )  # fmt: skip
    line_sharpness: float = varying(
        0.65, 0.05, 10, "Line sharpness", "How fast lines become opaque above the threshold.", "1/gray level", "Lines",
        "phi_e",
    )  # fmt: skip
    line_colour: str = colour(
        "#0e0b10", "Line colour", "Colour of full ink, as #rrggbb: a warm black by default.", "Lines"
    )
    line_opacity: float = varying(0.92, 0, 1, "Line opacity", "Opacity of full ink.", "ratio", "Lines")
    line_length: float = varying(
        40, 0, 300, "Shortest line",
        "Weak lines that are shorter are not drawn; stronger and important ones may be shorter, down to two thirds, "
        "in small faces less. Lines in texture, as in foliage, must be longer or stronger.",
        "per mille of the shorter side", "Lines"
    )  # fmt: skip

    # -- colour
    mean_shift_steps: int = Field(
        3, ge=0, le=20, title="Hue steps", description="Mean-shift iterations towards the reference's hues (eq. 1).",
        json_schema_extra={"unit": "steps", "group": "Colour", "symbol": "k"},
    )  # fmt: skip
    hue_neighbourhood: float = number(
        30, 1, 180, "Hue neighbourhood", "Width of the neighbourhood of mean shift (eq. 1).", "degrees",
        "Colour", "N(h)",
    )  # fmt: skip
    keep_brightness: float = varying(
        2 / 3, 0, 1, "Keep brightness", "Share of its own brightness that the video keeps with a reference (eq. 3).",
        "ratio", "Colour", "lambda",
    )  # fmt: skip
    vividness: float = varying(
        1.0, 0, 3, "Vividness", "Factor on the chroma of every region; 1 = unchanged.", "ratio", "Colour"
    )
    palette: tuple[Colour, ...] = colours(
        MOST_COLOURS, "Palette",
        "Colours to paint with, as #rrggbb: each region gets the nearest one in CIELAB, and keeps it while none is "
        "nearer by 6 CIELAB units. Without any, regions have their own colours.", "Colour",
    )  # fmt: skip

    # -- the printed algorithm
    algorithm: Literal["extended", "printed"] = choice(
        "extended", "Algorithm",
        "extended = with this method's additions for steadiness, faces and sharp edges; printed = the paper's "
        "algorithm without them, for comparison: one region for each area that a ball reaches, nothing corrected "
        "later, lines pixel by pixel.",
        "Algorithm",
    )  # fmt: skip

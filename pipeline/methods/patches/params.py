"""Every parameter of painting patches, with unit, range and the paper's symbol."""

from __future__ import annotations

from typing import Literal

from pipeline.methods.base import Params
from pipeline.methods.fields import FlowName, choice, number

Temporal = Literal["on", "off", "strokes"]
StyleName = Literal["hertzmann", "circles", "impressionist", "expressionist", "wash"]
BackgroundStyle = Literal["same", "hertzmann", "circles", "impressionist", "expressionist", "wash"]


class PatchesParams(Params):
    """Parameters of painterly video with painting patches (zhang2011patches)."""

    # -- painting
    style: StyleName = choice(
        "hertzmann", "Style",
        "How patches are painted: Hertzmann's curved strokes, the paper's circles, or another style of the library.",
        "Painting",
    )  # fmt: skip
    background_style: BackgroundStyle = choice(
        "same", "Style of the background", "A style of its own for the background.", "Painting"
    )
    stroke_size: float = number(
        1.0, 0.25, 4, "Stroke size",
        "Factor on all strokes. At 1, radii and lengths are the paper's table 1 in a picture 344 px high; they grow "
        "with the height, so that a painting looks alike at any size.", "ratio", "Painting", "r_max, l_min, l_max",
    )  # fmt: skip
    threshold: float = number(
        25, 0, 200, "Approximation threshold",
        "Finer strokes are painted where the painting is further than this from the picture, on calm ground from a "
        "third of it.",
        "RGB distance", "Painting", "T",
    )  # fmt: skip
    jitter: float = number(
        0.06, 0, 1, "Colour jitter", "How far a stroke's colour strays from the picture's.", "ratio", "Painting"
    )
    relief: float = number(
        0.6, 0, 3, "Relief", "Height of the paint in the light; 0 = flat.", "ratio", "Painting"
    )  # fmt: skip
    hold: int = number(
        1, 1, 6, "Frames a painting is held",
        "3 = on threes, about 10 paintings a second: the paper's advice, more like an animation by hand.",
        "frames", "Painting",
    )  # fmt: skip

    # -- time
    temporal: Temporal = choice(
        "on", "Temporal coherence",
        "on = painting patches; strokes = strokes carried from frame to frame by flow, as others do; "
        "off = every frame painted on its own (Hertzmann 1998).", "Time",
    )  # fmt: skip
    window: int = number(
        5, 2, 9, "Window",
        "Frames that are looked at together, up to the current one. Something hidden for up to window - 1 frames comes "
        "back with its old label and strokes. Shorter for fast motion.", "frames", "Time",
    )  # fmt: skip
    flow: FlowName = choice(
        "dis-medium", "Optical flow", "Dense inverse search (fast) or TV-L1 (the paper's, OpenCL).", "Time"
    )
    longest_patch: int = number(
        120, 8, 480, "Longest patch",
        "A painting lasts at most this long; then it fades over into the next.", "frames", "Time",
    )  # fmt: skip
    cut_sensitivity: float = number(
        1, 0, 3, "Cut sensitivity", "How readily a hard cut is called; 0 = never.", "ratio", "Time"
    )

    # -- clusters
    colour_scale: float = number(
        12, 1, 100, "Colour scale of reliability",
        "R = exp(-|c_x - c_y|) with colours in units of this many gray levels: sensor noise is about 5.",
        "gray levels", "Clusters",
    )  # fmt: skip
    reliable: float = number(
        0.3, 0.01, 0.95, "Reliable link",
        "Flow that links pixels with at least this R carries a label.", "R", "Clusters", "R",
    )  # fmt: skip
    interframe: float = number(
        1.0, 0, 1, "Weight of other frames", "Of links between frames, beside neighbours in a frame.", "ratio",
        "Clusters", "lambda",
    )  # fmt: skip
    colour_edges: float = number(
        1, 0, 4, "Colour edges",
        "How much a difference of colour, beside one of motion, keeps labels apart; 0 = motion alone, as printed.",
        "ratio", "Clusters",
    )  # fmt: skip
    motion_tolerance: float = number(
        0.5, 0.1, 5, "Motion tolerance",
        "What moves otherwise than the background by more than this is an object.",
        "px at the working size", "Clusters",
    )  # fmt: skip
    smallest_cluster: float = number(
        3, 0.1, 50, "Smallest cluster", "Smaller ones stay unclustered.", "per mille of the frame", "Clusters"
    )

    # -- patches
    stiffness: float = number(
        10, 0, 100, "Stiffness", "Of the springs to the flow's positions, beside 1 among neighbours.", "ratio",
        "Patches", "k",
    )  # fmt: skip
    rigidity: float = number(
        0.15, 0, 3, "Rigidity",
        "Flow that differs by less from its cluster's homography is taken for noise; 0 = never, as printed.",
        "px at the working size", "Patches",
    )  # fmt: skip
    misfit: float = number(
        28, 5, 400, "Misfit",
        "Where a frame differs by more from its patch, it is painted on its own; on calm ground, from a third of it.",
        "RGB distance", "Patches",
    )  # fmt: skip

"""Parameters of painting patches, with unit, range and the paper's symbol, and the library of stroke styles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

from pipeline.methods.base import Alternatives, Params, When
from pipeline.methods.fields import FlowName, RemovedValues, choice, number, varying

Temporal = Literal["on", "off"]
StyleName = Literal["hertzmann", "circles", "impressionist", "expressionist", "wash"]
TableArea = Literal["all-frames", "mean"]
BackgroundStyle = Literal["same", "hertzmann", "circles", "impressionist", "expressionist", "wash"]


@dataclass(frozen=True)
class StrokeStyle:
    """Stroke style: modifications of the values in table 1 of zhang2011patches.

    Attributes:
        length: factor on the table's lengths; 0 paints circles.
        radius: factor on the table's radii.
        opacity: 0..1.
        curvature: curvature filter f_c, 0..1: 1 = strokes follow the gradient's normal; lower values straighten them.
        jitter: colour jitter, added to the parameter `jitter`.
        saturation_shift: change of saturation, as a fraction of the full range.
        overlap: mean number of strokes on a pixel, see `LayerScheme`.
        threshold: factor on the approximation threshold T.
    """

    length: float = 1.0
    radius: float = 1.0
    opacity: float = 1.0
    curvature: float = 1.0
    jitter: float = 0.0
    saturation_shift: float = 0.0
    overlap: float = 3.0
    threshold: float = 1.0


STROKE_STYLES: dict[str, StrokeStyle] = {
    "hertzmann": StrokeStyle(),
    "circles": StrokeStyle(length=0.0, jitter=0.35, overlap=3.5, saturation_shift=0.05),
    "impressionist": StrokeStyle(length=0.35, jitter=0.12, threshold=1.6, saturation_shift=0.08, overlap=3.5),
    "expressionist": StrokeStyle(
        length=1.2, curvature=0.35, opacity=0.85, jitter=0.2, threshold=0.8, saturation_shift=0.12
    ),
    "wash": StrokeStyle(opacity=0.5, length=0.8, threshold=2.4, radius=1.3, jitter=0.04, overlap=5.0),
}


CLUSTERED: Alternatives = (When(params={"temporal": ("on",)}),)
"""Without temporal coherence there are no clusters."""
_OF_CLUSTERS = (
    "window", "longest_patch", "longest_travel", "table_area", "colour_scale", "reliable", "interframe",
    "colour_edges", "motion_tolerance", "smallest_cluster", "stiffness", "rigidity", "misfit", "background_style",
    "background_patches",
)  # fmt: skip


class PatchesParams(Params):
    """Parameters of painterly video with painting patches (zhang2011patches)."""

    deprecated_names: ClassVar[Mapping[str, str]] = {"hold": "frames_per_painting"}
    applies_when: ClassVar[Mapping[str, Alternatives]] = {
        **dict.fromkeys(_OF_CLUSTERS, CLUSTERED),
        "flow": (When(params={"temporal": ("on",)}, without_passes=("motion",)),),
    }
    removed_values: ClassVar[RemovedValues] = {
        "temporal": {"strokes": "Use temporal=on, or temporal=off for independent frames."}
    }

    # -- painting
    style: StyleName = choice(
        "hertzmann", "Style",
        "Stroke style of the patches: hertzmann = curved strokes, circles = dabs of colour, impressionist = short "
        "strokes, expressionist = long straight strokes of vivid colour, wash = broad transparent strokes.",
        "Painting",
    )  # fmt: skip
    background_style: BackgroundStyle = choice(
        "same", "Style of the background",
        "Stroke style of the background patches; same = the style of all other patches.", "Painting",
    )  # fmt: skip
    background_patches: int = number(
        1, 1, 8, "Background patches",
        "Number of patches of a shot that count as background: the one that moves as most of the frame does, and the "
        "largest others of at least a twentieth of the frame, such as a nearer wall that a camera passes.", "patches",
        "Painting",
    )  # fmt: skip
    stroke_size: float = number(
        1.0, 0.25, 4, "Stroke size",
        "Factor on width and length of all strokes: larger values give a broader, less detailed painting. At 1 a frame "
        "whose shorter side is 344 px has the strokes of the paper's table 1; strokes grow with that side.",
        "ratio", "Painting", "r_max, l_min, l_max",
    )  # fmt: skip
    threshold: float = number(
        25, 0, 200, "Approximation threshold",
        "Colour error above which finer strokes are added. Larger values leave out more detail. In smooth areas, where "
        "errors are more visible, a third of it applies.",
        "RGB distance", "Painting", "T",
    )  # fmt: skip
    face_detail: float = number(
        1, 0, 1, "Faces",
        "Additional fine strokes on faces, so that eyes and mouths of small faces can be recognised. Larger values "
        "make them cover more; 0 = none, as in the paper.", "ratio", "Painting",
    )  # fmt: skip
    jitter: float = number(
        0.06, 0, 1, "Colour jitter",
        "Random deviation of a stroke's colour from the picture. Larger values make neighbouring strokes differ more.",
        "ratio", "Painting",
    )  # fmt: skip
    relief: float = number(
        0.6, 0, 3, "Relief",
        "Height of the paint under the simulated light. Larger values show thicker strokes; 0 = flat.",
        "ratio", "Painting",
    )  # fmt: skip
    table_area: TableArea = choice(
        "all-frames", "Area for stroke sizes",
        "Area of a patch that determines the size of its strokes, by the paper's table 1: all-frames = the sum over "
        "all its frames, as in the paper; mean = of one frame, so that small objects have finer strokes: radius 2 up "
        "to 64 px, 4 up to 512 px, 8 above, in px of a frame 344 px high.", "Painting",
    )  # fmt: skip
    frames_per_painting: int = number(
        1, 1, 6, "Frames per painting",
        "Number of frames that show the same painting. 3 = on threes, about 10 paintings per second, as the paper "
        "recommends. Larger values look more like hand-made animation, and motion is less smooth.",
        "frames", "Painting",
    )  # fmt: skip

    # -- time
    temporal: Temporal = choice(
        "on", "Temporal coherence",
        "on = painting patches; off = every frame is painted independently (Hertzmann 1998).", "Time",
    )  # fmt: skip
    window: int = number(
        5, 2, 9, "Temporal window",
        "Number of frames, up to the current one, between which optical flow is computed. An object that is hidden for "
        "at most window - 1 frames returns with its label and its strokes. Use smaller values for fast motion; larger "
        "values take longer.", "frames", "Time",
    )  # fmt: skip
    flow: FlowName = choice(
        "dis-medium", "Optical flow",
        "Method that estimates motion: dense inverse search (dis, fast) or TV-L1 (the paper's, slower, on OpenCL).",
        "Time",
    )  # fmt: skip
    longest_patch: int = number(
        120, 8, 480, "Longest patch",
        "Longest duration of one painting of an object; then it cross-fades to a new one. Larger values keep the same "
        "strokes for longer, but fit changing light less well.", "frames", "Time",
    )  # fmt: skip
    longest_travel: float = number(
        2.5, 0.5, 12, "Longest travel",
        "Distance that one painting of an object, or of the background, may move before it cross-fades to a new one. "
        "Larger values keep the same strokes over a longer pan, and need memory for a wider panorama.",
        "longer sides of the frame", "Time",
    )  # fmt: skip
    cut_sensitivity: float = number(
        1, 0, 3, "Cut sensitivity",
        "Sensitivity of the detection of hard cuts, at which painting starts anew. Larger values detect more cuts; "
        "0 = no cuts.", "ratio", "Time",
    )  # fmt: skip

    # -- clusters
    colour_scale: float = number(
        12, 1, 100, "Colour scale of reliability",
        "Colour difference at which the reliability R of a motion vector falls to 1/e. Larger values trust motion "
        "vectors between less similar colours. Sensor noise is about 5.",
        "gray levels", "Clusters",
    )  # fmt: skip
    reliable: float = number(
        0.3, 0.01, 0.95, "Minimum reliability",
        "Reliability from which a motion vector propagates labels. Larger values leave more pixels unclustered.",
        "R", "Clusters", "R",
    )  # fmt: skip
    interframe: float = number(
        1.0, 0, 1, "Weight of other frames",
        "Weight of the labels of earlier frames relative to those of neighbouring pixels. Smaller values let cluster "
        "borders move more freely.", "ratio", "Clusters", "lambda",
    )  # fmt: skip
    colour_edges: float = number(
        1, 0, 4, "Colour edges",
        "Weight of colour differences relative to motion differences where clusters are separated. Larger values bind "
        "cluster borders to colour edges; 0 = motion only, as in the paper.", "ratio", "Clusters",
    )  # fmt: skip
    motion_tolerance: float = number(
        0.5, 0.1, 5, "Motion tolerance",
        "Difference from the background's motion above which a pixel belongs to an object. Larger values assign slow "
        "objects to the background.",
        "px at the working size", "Clusters",
    )  # fmt: skip
    smallest_cluster: float = number(
        3, 0.1, 50, "Smallest cluster",
        "Area below which a cluster stays unclustered. Larger values give fewer patches; 0.3 divides complex motion "
        "into many small ones.", "per mille of the frame", "Clusters",
    )  # fmt: skip

    # -- patches
    stiffness: float = number(
        10, 0, 100, "Stiffness",
        "Stiffness of the springs that attach a pixel to the position given by optical flow; the springs between "
        "neighbouring pixels have stiffness 1. Larger values follow the motion more exactly and distort strokes more.",
        "ratio", "Patches", "k",
    )  # fmt: skip
    rigidity: float = number(
        0.15, 0, 3, "Rigidity",
        "Deviation from the rigid motion of a cluster below which motion is treated as noise. Larger values keep "
        "strokes on rigid objects steadier; 0 = never, as in the paper.",
        "px at the working size", "Patches",
    )  # fmt: skip
    misfit: float = varying(
        28, 5, 400, "Misfit",
        "Colour difference between a patch and the frame above which the frame is painted instead. Larger values keep "
        "the patch's strokes, and changes such as an opening mouth appear less. In smooth areas a third of it applies.",
        "RGB distance", "Patches",
    )  # fmt: skip

"""Parameters of the method multistyle, with unit, range and the paper's symbol where it has one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Literal, get_args

from pipeline.methods.base import Alternatives, Params, When
from pipeline.methods.fields import FlowName, RemovedValues, Switch, choice, number, preroll, varying

StyleName = Literal["van-gogh", "impressionism", "expressionism", "pointillism", "colorist-wash", "watercolor"]
STYLE_NAMES: tuple[StyleName, ...] = get_args(StyleName)
Effect = Literal["none", "rack-focus", "emphasis", "calm-to-stress"]
Renderer = Literal["implicit", "explicit"]
StrokeOrder = Literal["mixed", "colour"]


_COHERENT = When(params={"temporal": ("on",)})
_SWEPT = When(params={"temporal": ("on",), "renderer": ("implicit",)})
_EASED = When(params={"temporal": ("on",), "renderer": ("explicit",)}, above={"ease": 0})


class MultistyleParams(Params):
    """Parameters of video painting with space-time-varying style (kagaya2011video).

    Parameters of the group Style change the chosen style for the whole picture. A design overrides them.
    """

    deprecated_names: ClassVar[Mapping[str, str]] = {"hold": "noise_floor", "linger": "accumulated_frames"}
    removed_values: ClassVar[RemovedValues] = {
        "renderer": {"implicit-literal": "Use renderer=implicit, which looks alike and is faster."}
    }

    applies_when: ClassVar[Mapping[str, Alternatives]] = {
        **dict.fromkeys(("edge_memory", "cut_sensitivity"), (_COHERENT,)),
        **dict.fromkeys(("flow", "stillness"), (When(params={"temporal": ("on",)}, without_passes=("motion",)),)),
        **dict.fromkeys(("noise_floor", "stroke_fade", "colour_follow"), (_SWEPT, _EASED)),
        "accumulated_frames": (_SWEPT,),
        "ease": (When(params={"temporal": ("on",), "renderer": ("explicit",)}),),
        "effect": (When(without=("design",), way="film"),),
        "objects": (
            When(inputs=("design",)), When(params={"effect": ("rack-focus", "emphasis", "calm-to-stress")}, way="film"),
        ),
        "preroll": (When(params={"temporal": ("on",)}, way="piece"),),
    }  # fmt: skip

    @property
    def effective(self) -> MultistyleParams:
        """The parameters as the renderer uses them: `ease` scales the temporal smoothing of explicit strokes."""
        if self.renderer != "explicit":
            return self
        follow, fade = (self.ease * value + (1 - self.ease) for value in (self.colour_follow, self.stroke_fade))
        return self.model_copy(
            update={"noise_floor": self.ease * self.noise_floor, "colour_follow": follow, "stroke_fade": fade}
        )

    # -- style
    style: StyleName = choice("van-gogh", "Style", "Style of all regions for which no design sets a style.", "Style")
    renderer: Renderer = choice(
        "implicit", "Renderer",
        "implicit = discs swept along the stroke directions, with soft edges and less flicker; explicit = every "
        "stroke is a curve with crisp edges and ends.", "Style",
    )  # fmt: skip
    stroke_order: StrokeOrder = choice(
        "mixed", "Painting order",
        "Which of two strokes of a layer covers the other: mixed = the darker one, with random variation that differs "
        "by style; colour = the paper's total order (luminance, then green, red, blue).", "Style",
    )  # fmt: skip
    stroke_size: float = varying(1, 0.25, 4, "Stroke size", "Factor on the width of strokes.", "ratio", "Style")
    stroke_length: float = varying(
        1, 0, 4, "Stroke length", "Factor on the length of strokes; 0 = dots.", "ratio", "Style"
    )
    opacity: float = varying(1, 0.1, 2, "Opacity", "Factor on the opacity of strokes.", "ratio", "Style")
    hue: float = varying(0, -180, 180, "Hue", "Shift of hue of all strokes.", "degrees", "Style")
    saturation: float = varying(0, -1, 1, "Saturation", "Shift of saturation.", "ratio", "Style")
    value: float = varying(0, -1, 1, "Brightness", "Shift of brightness.", "ratio", "Style")
    jitter: float = varying(
        1, 0, 3, "Colour jitter", "Factor on the random variation of colour between strokes.", "ratio", "Style"
    )
    relief: float = varying(1, 0, 4, "Relief", "Factor on the height of the paint.", "ratio", "Style")
    grain: float = varying(1, 0, 2, "Grain", "Factor on the bristle texture in strokes.", "ratio", "Style")
    layers: float = varying(0, -2, 2, "Layers", "Number of layers added to those of the style.", "layers", "Style")
    threshold: float = varying(
        1, 0, 4, "Error threshold", "Factor on the error above which finer strokes are painted; 0 = everywhere.",
        "ratio", "Style",
    )  # fmt: skip

    effect: Effect = choice(
        "none", "Effect",
        "A ready-made design, used if the job has no design: rack-focus = focus moves from the subject to the "
        "background; emphasis = a fine, vivid subject before a broad, dull background; calm-to-stress = strokes become "
        "short and restless over the video.", "Style",
    )  # fmt: skip

    objects: int = number(
        8, 2, 64, "Objects", "Number of objects that the regions of each shot are merged to, for designs and effects.",
        "objects", "Style",
    )  # fmt: skip

    # -- detail
    face_detail: float = number(
        1, 0, 1, "Faces", "Finer strokes on faces: 1 = half the size and one more layer.", "ratio", "Detail"
    )
    saliency_detail: float = number(
        0.25, 0, 1, "Salient things", "Finer strokes on things that stand out in a frame.", "ratio", "Detail"
    )
    motion_detail: float = number(
        0.2, 0, 1, "Moving things", "Finer strokes on what moves relative to the background.", "ratio", "Detail"
    )

    # -- direction
    edge_smoothing: float = number(
        11, 1, 100, "Edge smoothing", "Sigma of the Gaussian blur of the edge field.", "per mille of the shorter side",
        "Direction",
    )  # fmt: skip
    direction_rows: int = number(
        160, 40, 2160, "Resolution of directions",
        "Approximate number of directions on the shorter side, at most one per pixel of the analysis (half the frame's "
        "from 400 rows on). Edge smoothing below 5 raises it. Larger values follow finer structures and borders of "
        "regions, and take longer.", "directions", "Direction",
    )  # fmt: skip
    edge_memory: float = number(
        0.85, 0, 0.98, "Edge memory", "Weight of previous frames in the edge field, along the motion.", "ratio",
        "Direction",
    )  # fmt: skip
    default_angle: float = varying(
        -35, -90, 90, "Default direction", "Stroke angle where the picture has no edges nearby.", "degrees",
        "Direction",
    )  # fmt: skip

    # -- time
    temporal: Switch = choice(
        "on", "Temporal coherence", "off = every frame is painted independently, as a baseline; it flickers.", "Time"
    )
    flow: FlowName = choice("dis-medium", "Optical flow", "Algorithm that estimates the motion of strokes.", "Time")
    stillness: float = number(
        2, 0, 20, "Stillness", "A pixel whose 5x5 surroundings change by at most this counts as unchanged.",
        "gray levels", "Time",
    )  # fmt: skip
    noise_floor: float = number(
        3, 0, 20, "Noise floor", "Colours that change by less, over 5x5 px, keep their value, so that noise is not "
        "painted.", "gray levels", "Time",
    )  # fmt: skip
    stroke_fade: float = number(
        0.3, 0.02, 1, "Stroke fade", "Change of a stroke's opacity per frame while it appears or disappears.", "ratio",
        "Time",
    )  # fmt: skip
    colour_follow: float = number(
        0.4, 0.01, 1, "Colour follow", "Fraction of the colour difference to the picture that a stroke makes up a "
        "frame.", "ratio", "Time",
    )  # fmt: skip
    accumulated_frames: int = number(
        2, 0, 4, "Accumulated frames",
        "Each painting is averaged with this many previous ones, aligned along the motion, where they show the same "
        "surface; not for explicit strokes.", "frames", "Time",
    )  # fmt: skip
    ease: float = number(
        0, 0, 1, "Smoothing of explicit strokes", "Weight of noise floor, stroke fade and colour follow with explicit "
        "strokes: 0 = strokes show each frame's colours and appear at once, as in the paper.", "ratio", "Time",
    )  # fmt: skip
    cut_sensitivity: float = number(
        1, 0, 3, "Cut sensitivity", "How readily a hard cut is detected, at which everything starts anew; 0 = never.",
        "ratio", "Time",
    )  # fmt: skip
    preroll: int = preroll(250)

    @property
    def lead_frames(self) -> int:
        return self.preroll if self.temporal == "on" else 0

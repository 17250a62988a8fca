"""Every parameter of the multistyle method, with unit, range and the paper's symbol where it has one."""

from __future__ import annotations

from typing import Literal

from pipeline.methods.base import Params
from pipeline.methods.fields import choice, number
from pipeline.methods.multistyle.effects import Effect
from pipeline.methods.multistyle.styles import StyleName
from pipeline.strokes.layers import Renderer

Switch = Literal["on", "off"]
FlowName = Literal["dis-ultrafast", "dis-fast", "dis-medium", "tvl1"]


class MultistyleParams(Params):
    """Parameters of video painting with space-time-varying style (kagaya2011video).

    Those of the group Style change the chosen style for the whole picture; a design goes before them.
    """

    @property
    def eased(self) -> MultistyleParams:
        """With what the renderer takes of hold, stroke fade and colour follow."""
        if self.renderer == "implicit":
            return self
        follow, fade = (self.ease * value + (1 - self.ease) for value in (self.colour_follow, self.stroke_fade))
        return self.model_copy(update={"hold": self.ease * self.hold, "colour_follow": follow, "stroke_fade": fade})

    # -- style
    style: StyleName = choice(
        "van-gogh", "Style", "How the picture is painted where no design says otherwise.", "Style"
    )
    renderer: Renderer = choice(
        "implicit", "Renderer",
        "implicit = seeds are drawn out along the stroke directions, the steadier one; explicit = every stroke is a "
        "curve of its own, with ends and hairs.", "Style",
    )  # fmt: skip
    stroke_size: float = number(1, 0.25, 4, "Stroke size", "Factor on the width of strokes.", "ratio", "Style")
    stroke_length: float = number(
        1, 0, 4, "Stroke length", "Factor on the length of strokes; 0 = dots.", "ratio", "Style"
    )
    opacity: float = number(1, 0.1, 2, "Opacity", "Factor on the opacity of strokes.", "ratio", "Style")
    hue: float = number(0, -180, 180, "Hue", "Shift of hue of all strokes.", "degrees", "Style")
    saturation: float = number(0, -1, 1, "Saturation", "Shift of saturation.", "ratio", "Style")
    value: float = number(0, -1, 1, "Brightness", "Shift of brightness.", "ratio", "Style")
    jitter: float = number(
        1, 0, 3, "Colour jitter", "Factor on how far colours of single strokes stray.", "ratio", "Style"
    )
    relief: float = number(1, 0, 4, "Relief", "Factor on the height of the texture in strokes.", "ratio", "Style")
    grain: float = number(1, 0, 2, "Grain", "Factor on the density of the texture in strokes.", "ratio", "Style")
    layers: float = number(0, -2, 2, "Layers", "Added to the style's number of layers.", "layers", "Style")
    threshold: float = number(
        1, 0, 4, "Error threshold", "Factor on the error above which finer strokes are painted; 0 = everywhere.",
        "ratio", "Style",
    )  # fmt: skip

    effect: Effect = choice(
        "none", "Effect",
        "A ready design, where none is given: rack-focus = from the subject to the background; emphasis = a fine, "
        "vivid subject before a broad, dull background; calm-to-stress = over the whole video.", "Style",
    )  # fmt: skip

    # -- detail
    face_detail: float = number(
        1, 0, 1, "Faces", "How much finer faces are painted: 1 = half the size, a layer more.", "ratio", "Detail"
    )
    saliency_detail: float = number(
        0.25, 0, 1, "Salient things", "The same for what stands out in a frame.", "ratio", "Detail"
    )
    motion_detail: float = number(
        0.2, 0, 1, "Moving things", "The same for what moves against the camera.", "ratio", "Detail"
    )

    # -- direction
    edge_smoothing: float = number(
        11, 1, 100, "Edge smoothing", "Sigma of the Gaussian over the edge field.", "per mille of the height",
        "Direction",
    )  # fmt: skip
    edge_memory: float = number(
        0.85, 0, 0.98, "Edge memory", "Weight of the past in the edge field, along the motion.", "ratio", "Direction"
    )
    default_angle: float = number(
        -35, -90, 90, "Default direction", "Where the picture runs nowhere, strokes run at this angle.", "degrees",
        "Direction",
    )  # fmt: skip

    # -- time
    temporal: Switch = choice(
        "on", "Temporal coherence", "off = every frame on its own: the honest baseline, and it flickers.", "Time"
    )
    flow: FlowName = choice("dis-medium", "Optical flow", "Motion that carries strokes from frame to frame.", "Time")
    stillness: float = number(
        2, 0, 20, "Stillness", "A pixel whose 5x5 surroundings changed by at most this stands still.", "gray levels",
        "Time",
    )  # fmt: skip
    hold: float = number(
        3, 0, 20, "Hold", "Colours that change by less, over 5x5 px, stay as they were: noise is not painted.",
        "gray levels", "Time",
    )  # fmt: skip
    stroke_fade: float = number(
        0.3, 0.02, 1, "Stroke fade", "How much of a new stroke comes up, or of an old one goes, in a frame.", "ratio",
        "Time",
    )  # fmt: skip
    colour_follow: float = number(
        0.4, 0.01, 1, "Colour follow", "How far a stroke's colour goes towards the picture's in a frame.", "ratio",
        "Time",
    )  # fmt: skip
    linger: int = number(
        2, 0, 4, "Paint lingers",
        "Each painting is averaged with so many before it, carried along the motion, where they show the same thing; "
        "for the implicit renderer.", "frames", "Time",
    )  # fmt: skip
    ease: float = number(
        0, 0, 1, "Ease of explicit strokes", "How far the explicit renderer takes part in hold, stroke fade and colour "
        "follow: 0 = its strokes show this frame's colours, and come and go at once, as the paper has it.", "ratio",
        "Time",
    )  # fmt: skip
    cut_sensitivity: float = number(
        1, 0, 3, "Cut sensitivity", "How readily a hard cut is called, which starts everything afresh; 0 = never.",
        "ratio", "Time",
    )  # fmt: skip

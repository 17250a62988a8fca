"""Every parameter of the steady method, with unit, range and the paper's symbol."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

from pipeline.methods.base import Alternatives, Params, When
from pipeline.methods.fields import number, preroll, varying


class SteadyParams(Params):
    """Parameters of blind video temporal consistency (bonneel2015blind)."""

    strength: float = varying(
        40, 0, 200, "Strength",
        "Weight of the previous result, moved along the motion, relative to the gradients of the styled frame. "
        "0 = the styled video as it is.", "ratio", "Time", "lambda",
    )  # fmt: skip
    trail_suppression: float = varying(
        25, 0, 1000, "Trail suppression",
        "How fast the weight falls where the source differs from what the motion predicts. Higher values leave fewer "
        "trails and more flicker on things that move fast.", "per squared RGB distance, RGB in 0..1", "Time", "alpha",
    )  # fmt: skip
    colour_half_life: float = varying(
        60, 0, 1000, "Colour half-life",
        "Time in which the result loses half of its difference to the colours of the styled video. 0 = never.",
        "frames", "Time",
    )  # fmt: skip
    cut_sensitivity: float = number(
        1, 0, 3, "Cut sensitivity", "How readily a hard cut is detected, where the result starts afresh. 0 = never.",
        "ratio", "Time",
    )  # fmt: skip
    look_ahead: int = number(
        0, 0, 8, "Look ahead",
        "Number of later frames that each result is averaged with, in a second pass backwards in time: less flicker, "
        "slightly softer texture, 1.5 times the processor time. 0 = past frames only; live streams always have 0.",
        "frames", "Time",
    )  # fmt: skip
    applies_when: ClassVar[Mapping[str, Alternatives]] = {
        "look_ahead": (When(way="film"),), "preroll": (When(way="piece"),),
    }  # fmt: skip

    preroll: int = preroll(250)

    @property
    def lead_frames(self) -> int:
        return self.preroll

    detail: float = varying(
        1, 0, 1, "Restored detail",
        "Share of the fine detail that the styled frames have and the result lacks which is restored by sharpening. "
        "0 = off; higher values flicker more.",
        "ratio", "Detail",
    )  # fmt: skip

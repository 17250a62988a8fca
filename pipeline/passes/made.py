"""Passes that methods make beside their film, as data. `pass_archive` writes their files, in one of `PASS_FORMATS`."""

from __future__ import annotations

from dataclasses import dataclass

PASSES = "passes"
"""Name of the artefact with the passes of a job."""


@dataclass(frozen=True)
class MadePass:
    """A pass that a method can make of every frame.

    Attributes:
        name: in requests, and of the layer in files; [a-z-].
        help: what it holds, one sentence.
        channels: names of its channels in the layer.
        unit: of its values, for example "px".
        ids: whether values are whole numbers, 0 = none; else they are floating point.
        png_zero, png_scale: the number `png_zero + png_scale * value`, 0..65535, stands in a PNG. Whole numbers have
            65536 G + R instead.
    """

    name: str
    help: str
    channels: tuple[str, ...]
    unit: str = ""
    ids: bool = False
    png_zero: float = 0.0
    png_scale: float = 65535.0


PNG_MIDDLE = 32768.0
"""`MadePass.png_zero` of values of both signs."""
FLOW = MadePass(
    "flow",
    "Motion from each pixel back to the previous frame, y down; 0 in the first frame of a shot.",
    ("X", "Y"),
    "px",
    png_zero=PNG_MIDDLE,
    png_scale=64.0,
)
"""The motion that a method uses; all methods make this pass."""

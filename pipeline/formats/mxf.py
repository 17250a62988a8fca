"""MXF (OP1a): DNxHR and ProRes with uncompressed sound, for editing. All frames have one duration."""

from __future__ import annotations

from fractions import Fraction

from pipeline.formats.base import OutputFormat, SoundCodecs
from pipeline.formats.codecs import DNXHR, PRORES_HQ

_RATES = (
    Fraction(24000, 1001), Fraction(24), Fraction(25), Fraction(30000, 1001), Fraction(30), Fraction(50),
    Fraction(60000, 1001), Fraction(60),
)  # fmt: skip
MXF = OutputFormat(
    name="mxf", title="MXF", help="For editing: DNxHR, ProRes; constant frame rate", media_type="application/mxf",
    suffixes=(".mxf",), profiles=(*DNXHR, PRORES_HQ), shown_as="sheet", container="mxf",
    sound=SoundCodecs(copied=frozenset({"pcm_s16le", "pcm_s24le"}), encoder="pcm_s24le"), timecode=True, rates=_RATES,
)  # fmt: skip

"""Colours of sources: HDR and wide-gamut video by its tags, and pictures of a colour space that the user names, become
sRGB; and sRGB pictures become the signal of HDR films.

PQ and HLG are light of a display. Diffuse white (203 cd/m2, ITU-R BT.2408) becomes white, and light above it is
compressed into the last two hundredths, by the same factor for red, green and blue, so that highlights keep their hue.
A view of OpenColorIO gives them more room, and makes white darker. Video with primaries of BT.2020 or P3 and an SDR
transfer keeps its transfer function: its primaries are converted in the light of the display.

The transforms are OpenColorIO's: SMPTE ST 2084; ITU-R BT.2100-2 (HLG for a peak of 1000 cd/m2); BT.1886.
"""

from __future__ import annotations

from functools import lru_cache

import av
import numpy as np
import PyOpenColorIO as OCIO  # noqa: N814

from pipeline.arrays import AnyArray
from pipeline.colour.ocio import Picture, applied, encoded, from_display, interop_id, linear, processor_of, to_display
from pipeline.video.depth import as_float, with_opacity
from pipeline.video.media import Note, SourceOptions
from pipeline.video.opacity import unpremultiplied

PQ, HLG = 16, 18
"""Transfer characteristics (ISO/IEC 23091-2)."""
_WHITE_CD_M2 = 203.0
_BT2020, _P3 = 9, 12
FILM_SIGNALS = {"PQ": PQ, "HLG": HLG}
"""Names of the signals of HDR films (ITU-R BT.2100) -> transfer characteristics."""
_INTEROP_IDS = {"pq_rec2020_display": PQ, "hlg_rec2020_display": HLG}
_NAMES = {_BT2020: "BT.2020", _P3: "P3"}
"""Code of primaries (ISO/IEC 23091-2) -> name."""
_ROOM = np.float32(0.04)
"""Share of the light, below white, into which light above 1 - _ROOM is compressed."""
_XYZ_TO_709 = (
    (3.2409699, -1.5373832, -0.4986108), (-0.9692436, 1.8759675, 0.0415551), (0.0556301, -0.2039770, 1.0569715)
)  # fmt: skip
"""Matrix from CIE XYZ to linear light of Rec. 709, both with the white D65. Source: IEC 61966-2-1."""

Signal = tuple[int, int]
"""Primaries and transfer characteristics of a picture, ISO/IEC 23091-2."""


def wide_signal(picture: av.VideoFrame) -> Signal | None:
    """The signal of a picture that must be converted; None: sRGB, BT.709 and what is shown like them."""
    primaries, transfer = int(picture.color_primaries), int(picture.color_trc)
    return (primaries, transfer) if primaries in _NAMES or transfer in (PQ, HLG) else None


def colour_notes(signal: Signal | None, options: SourceOptions) -> tuple[Note, ...]:
    """Notes on the conversion of colours: what the file says, or what the user has given instead."""
    through = f" through the view {options.colour_view!r}" if options.colour_view else ""
    if options.colour:
        return (Note("assumed", f"Colours were read as {options.colour}, as given, and shown{through} in sRGB."),)
    if signal is None:
        unused = f"The view {options.colour_view!r} has no effect: the colours are those of a display already."
        return (Note("assumed", unused),) if through else ()
    transfer = {PQ: " PQ", HLG: " HLG"}.get(signal[1], "")
    white = f" Light above {_WHITE_CD_M2:g} cd/m2 is white." if transfer and not through else ""
    named = f"{_NAMES.get(signal[0], 'BT.709')}{transfer}"
    return (Note("assumed", f"Colours were converted from {named} to sRGB{through}.{white}"),)


def shown(pixels: AnyArray, signal: Signal | None, options: SourceOptions) -> AnyArray:
    """The sRGB-encoded picture of R'G'B' of full range, (h, w, 3) or (h, w, 4) with straight opacity: float32,
    unclipped; the same array if its colours are sRGB."""
    if not options.colour and signal is None:
        return pixels
    if pixels.shape[2] == 4 and options.premultiplied:
        pixels = unpremultiplied(pixels)
    values = as_float(pixels)
    if options.colour:
        colours = to_display(values[..., :3], options.colour, options.colour_view)
    else:
        assert signal is not None
        colours = _converted(values[..., :3], signal, options.colour_view)
    return colours if pixels.shape[2] == 3 else with_opacity(colours, pixels[..., 3])


def _converted(values: Picture, signal: Signal, view: str) -> Picture:
    primaries, transfer = signal
    if transfer not in (PQ, HLG):
        return applied(_primaries_only(primaries), values)
    style = _style(signal)
    if view:
        return to_display(values, f"{style}_display", view)
    return encoded(_rolled_off(applied(_light(style), values)))


def film_signal(colour: str) -> Signal | None:
    """The signal of an HDR film: "PQ" or "HLG", or a colour space of the configuration that is one of them; None: it
    names no such signal."""
    if not colour:
        return None
    transfer = FILM_SIGNALS.get(colour.upper()) or _INTEROP_IDS.get(interop_id(colour))
    return None if transfer is None else (_BT2020, transfer)


def film_values(picture: AnyArray, signal: Signal, view: str = "") -> AnyArray:
    """R'G'B' of an HDR film, float32, of an sRGB picture, (h, w, 3) or (h, w, 4) with straight opacity.

    White becomes diffuse white, 203 cd/m2: light that was compressed into it is not known any more. With a view, its
    inverse is applied.
    """
    colours, style = as_float(picture)[..., :3], _style(signal)
    found = from_display(colours, f"{style}_display", view) if view else applied(_light(style, True), linear(colours))
    return found if picture.shape[2] == 3 else with_opacity(found, picture[..., 3])


def _style(signal: Signal) -> str:
    primaries, transfer = signal
    return "hlg_rec2020" if transfer == HLG else "pq_p3d65" if primaries == _P3 else "pq_rec2020"


def _rolled_off(light: Picture) -> Picture:
    """Light above 1 - _ROOM compressed to at most 1: multiplied by a factor that depends on the largest channel."""
    most = np.maximum(light.max(-1, keepdims=True), np.float32(1e-6))
    above = np.maximum((most - 1) / _ROOM + 1, 0)
    return np.asarray(light * np.where(above > 0, (1 - _ROOM + _ROOM * above / (1 + above)) / most, 1), np.float32)


@lru_cache(5)
def _light(style: str, inverse: bool = False) -> OCIO.CPUProcessor:
    """Conversion from the signal of an HDR display to linear light of Rec. 709 (diffuse white = 1), or back."""
    name = {"hlg_rec2020": "REC.2100-HLG-1000nit", "pq_p3d65": "ST2084-P3-D65", "pq_rec2020": "REC.2100-PQ"}[style]
    matrix = np.eye(4)
    matrix[:3, :3] = np.array(_XYZ_TO_709) * 100 / _WHITE_CD_M2  # OpenColorIO's 1 is 100 cd/m2
    found = OCIO.GroupTransform([_to_xyz(name), OCIO.MatrixTransform(matrix=matrix.ravel().tolist())])
    if inverse:
        found.setDirection(OCIO.TRANSFORM_DIR_INVERSE)
    return processor_of(found, fast=True)


@lru_cache(2)
def _primaries_only(primaries: int) -> OCIO.CPUProcessor:
    wide, usual = ("REC.1886-REC.2020", "REC.1886-REC.709") if primaries == _BT2020 else ("DisplayP3", "sRGB")
    back = OCIO.BuiltinTransform(style=f"DISPLAY - CIE-XYZ-D65_to_{usual}")
    return processor_of(OCIO.GroupTransform([_to_xyz(wide), back]), fast=True)


def _to_xyz(display: str) -> OCIO.BuiltinTransform:
    style = f"DISPLAY - CIE-XYZ-D65_to_{display}"
    return OCIO.BuiltinTransform(style=style, direction=OCIO.TRANSFORM_DIR_INVERSE)

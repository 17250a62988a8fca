"""Colour management by OpenColorIO: pictures of any colour space become display-referred sRGB, in which methods paint,
and films become any colour space again.

Colour spaces and views are named as in the configuration: that of the environment variable OCIO, as in other programs,
else the ACES studio configuration that OpenColorIO contains. Its version is fixed, so that an update of the library
changes no picture.

Without a view, scene-referred light is not tone-mapped: light of 1 is white, and values above 1 stay above 1.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import PyOpenColorIO as OCIO  # noqa: N814
from numpy.typing import NDArray

from pipeline.errors import BadParameter, did_you_mean

BUILT_IN = "ocio://studio-config-v4.0.0_aces-v2.0_ocio-v2.5"
LINEAR_709 = "lin_rec709"
"""Linear light in the primaries of Rec. 709, an alias in ACES configurations."""
_DISPLAY = "srgb_display"
"""sRGB as a display shows it, an alias in ACES configurations."""

Picture = NDArray[np.float32]


@lru_cache(1)
def config() -> OCIO.Config:
    """The configuration of this process. Raises BadParameter: the file that OCIO names cannot be read."""
    given = OCIO.GetEnvVariable("OCIO") if OCIO.IsEnvVariablePresent("OCIO") else ""
    try:
        return OCIO.Config.CreateFromFile(given or BUILT_IN)
    except (OCIO.Exception, OCIO.ExceptionMissingFile) as error:
        raise BadParameter(
            f"The configuration of OpenColorIO cannot be read: {error}", field="OCIO", value=given,
            remedy="Set OCIO to a file that can be read, or unset it.",
        ) from None  # fmt: skip


def check_space(name: str, field: str) -> None:
    """Raise BadParameter if the configuration has no colour space (or alias, or role) of this name."""
    if name and config().getColorSpace(name) is None:
        known = list(config().getColorSpaceNames())
        raise BadParameter("The OpenColorIO configuration has no such colour space.", field=field, value=name,
                           remedy=did_you_mean(name, known, "colour spaces"))  # fmt: skip


def check_view(name: str, field: str) -> None:
    """Raise BadParameter if the display of the configuration has no view of this name."""
    if name and name not in (known := list(config().getViews(_display()))):
        raise BadParameter(f"The display {_display()!r} has no such view.", field=field, value=name,
                           remedy=f"Use one of: {', '.join(known)}.")  # fmt: skip


def to_display(colours: Picture, space: str, view: str = "") -> Picture:
    """Display-referred sRGB of colours of a space, float32 (h, w, 3) with white at 1, unclipped.

    Args:
        space, view: names of the configuration; "": no tone map.

    Raises: BadParameter.
    """
    return applied(_between(space, view, False), colours)


def from_display(colours: Picture, space: str, view: str = "") -> Picture:
    """The inverse of `to_display`."""
    return applied(_between(space, view, True), colours)


def interop_id(space: str) -> str:
    """The identifier of a colour space for other programs; "": it has none."""
    found = config().getColorSpace(space)
    return "" if found is None else str(found.getInteropID())


def encoded(light: Picture) -> Picture:
    """sRGB-encoded values of linear light, float32 (h, w, 3); the curve goes on above 1, and mirrored below 0.
    Source: IEC 61966-2-1."""
    return applied(_curve(True), light)


def linear(values: Picture) -> Picture:
    """The inverse of `encoded`."""
    return applied(_curve(False), values)


@lru_cache(2)
def _curve(encode: bool) -> OCIO.CPUProcessor:
    curve = OCIO.ExponentWithLinearTransform(
        gamma=[2.4, 2.4, 2.4, 1], offset=[0.055, 0.055, 0.055, 0], negativeStyle=OCIO.NEGATIVE_MIRROR,
        direction=OCIO.TRANSFORM_DIR_INVERSE if encode else OCIO.TRANSFORM_DIR_FORWARD,
    )  # fmt: skip
    return processor_of(curve)


@lru_cache(16)
def _between(space: str, view: str, inverse: bool) -> OCIO.CPUProcessor:
    check_space(space, "source.colour")
    check_view(view, "source.colour_view")
    if view:
        found: OCIO.Transform = OCIO.DisplayViewTransform(src=space, display=_display(), view=view)
    elif config().getColorSpace(_DISPLAY) is not None:
        found = OCIO.ColorSpaceTransform(src=space, dst=_DISPLAY)
    else:
        raise BadParameter(
            "The OpenColorIO configuration has no colour space sRGB - Display.", field="source.colour_view",
            remedy=f"Name a view: {', '.join(config().getViews(_display()))}.",
        )  # fmt: skip
    if inverse:
        found.setDirection(OCIO.TRANSFORM_DIR_INVERSE)
    try:
        return processor_of(found, config())
    except (OCIO.Exception, OCIO.ExceptionMissingFile) as error:
        raise BadParameter(f"OpenColorIO cannot convert the colours: {error}", field="source.colour", value=space,
                           remedy="Use another view or colour space.") from None  # fmt: skip


def _display() -> str:
    """The display of sRGB in the configuration, else its usual one."""
    space = config().getColorSpace(_DISPLAY)
    name = "" if space is None else str(space.getName())
    return name if name in list(config().getDisplays()) else str(config().getDefaultDisplay())


def processor_of(transform: OCIO.Transform, under: OCIO.Config | None = None, fast: bool = False) -> OCIO.CPUProcessor:
    """A processor of the transform.

    Args:
        fast: whether powers and logarithms may be off by 1 part in 100,000, by instructions that every x86-64 processor
            has. PQ takes six times as long without.
    """
    optimization = OCIO.OPTIMIZATION_DEFAULT if fast else OCIO.OPTIMIZATION_LOSSLESS
    return (under or _raw()).getProcessor(transform).getOptimizedCPUProcessor(optimization)


@lru_cache(1)
def _raw() -> OCIO.Config:
    return OCIO.Config.CreateRaw()


def applied(processor: OCIO.CPUProcessor, colours: NDArray[Any]) -> Picture:
    """The processor's values for colours (h, w, 3); not a number becomes 0."""
    out = np.nan_to_num(np.array(colours, np.float32, order="C"), copy=False, posinf=65504, neginf=-65504)
    height, width = out.shape[:2]
    processor.apply(OCIO.PackedImageDesc(out, width, height, 3))
    return out

"""Checks of the output of a submitted request."""

from __future__ import annotations

from typing import get_args

from pipeline.errors import BadInput, BadParameter, together
from pipeline.formats import OUTPUTS, output_format
from pipeline.formats.base import OutputFormat, Profile
from pipeline.methods.base import Method
from workers.contract.record import Asset
from workers.contract.request import MAX_QUALITY, Alpha, OutputSpec


def check_output(chosen: Method, output: OutputSpec) -> None:
    """Check that the method and the format can make such an output. Raises BadParameter."""
    if found := output_faults(chosen, output):
        raise together(found)


def output_faults(chosen: Method, output: OutputSpec, video: Asset | None = None) -> list[BadInput]:
    """Faults of an output that the method and the format cannot make of the video."""
    known = ", ".join(chosen.artefacts) or "none"
    found: list[BadInput] = [
        _fault("output.artefacts", artefact, f"The method {chosen.name!r} makes: {known}.")
        for artefact in output.artefacts if artefact not in chosen.artefacts
    ]  # fmt: skip
    if not 0 <= output.quality <= MAX_QUALITY:
        found.append(_fault("output.quality", output.quality, f"Use 0 (lossless) to {MAX_QUALITY}."))
    try:
        form = output_format(output.format)
        profile = form.profile(output.profile)
        if video is not None and video.info.get("width"):
            form.check(profile, (int(video.info["width"]), int(video.info["height"])), float(video.info["fps"]))
        _check_alpha(chosen, form, profile, output.alpha)
    except BadParameter as fault:
        found.append(fault)
    return found


def _check_alpha(chosen: Method, form: OutputFormat, profile: Profile, alpha: Alpha) -> None:
    if alpha not in get_args(Alpha):
        raise _fault("output.alpha", alpha, f"Use one of: {', '.join(get_args(Alpha))}.")
    if alpha == "painted":
        message = f"The method {chosen.name!r} paints no opacity of its own."
        raise BadParameter(message, field="output.alpha", value=alpha, remedy="Use source or none.")
    if alpha == "source" and not profile.has_alpha:
        others = [
            f"{each.name} {other.name}" for each in OUTPUTS.values() for other in each.profiles if other.has_alpha
        ]
        raise BadParameter(
            f"{form.title}, {profile.title} has no opacity.", field="output.alpha", value=alpha,
            remedy=f"Use none, or one of: {', '.join(others)}.",
        )  # fmt: skip


def _fault(field: str, value: object, remedy: str) -> BadParameter:
    return BadParameter("Not accepted.", field=field, value=value, remedy=remedy)

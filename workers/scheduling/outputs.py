"""Checks of the output of a submitted request."""

from __future__ import annotations

from typing import NoReturn, get_args

from pipeline.errors import BadParameter
from pipeline.formats import OUTPUTS, output_format
from pipeline.formats.base import OutputFormat, Profile
from pipeline.methods.base import Method
from workers.contract.record import Asset
from workers.contract.request import MAX_QUALITY, Alpha, OutputSpec


def check_output(chosen: Method, output: OutputSpec, video: Asset | None = None) -> None:
    """Check that the method and the format can make such an output of the video. Raises BadParameter."""
    form = output_format(output.format)
    profile = form.profile(output.profile)
    if video is not None and video.info.get("width"):
        form.check(profile, (int(video.info["width"]), int(video.info["height"])), float(video.info["fps"]))
    if not 0 <= output.quality <= MAX_QUALITY:
        _refuse("output.quality", output.quality, f"Use 0 (lossless) to {MAX_QUALITY}.")
    _check_alpha(chosen, form, profile, output.alpha)
    for artefact in output.artefacts:
        if artefact not in chosen.artefacts:
            known = ", ".join(chosen.artefacts) or "none"
            _refuse("output.artefacts", artefact, f"The method {chosen.name!r} makes: {known}.")


def _check_alpha(chosen: Method, form: OutputFormat, profile: Profile, alpha: Alpha) -> None:
    if alpha not in get_args(Alpha):
        _refuse("output.alpha", alpha, f"Use one of: {', '.join(get_args(Alpha))}.")
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


def _refuse(field: str, value: object, remedy: str) -> NoReturn:
    raise BadParameter("Not accepted.", field=field, value=value, remedy=remedy)

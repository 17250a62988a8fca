"""Checks of the output of a submitted request."""

from __future__ import annotations

from typing import get_args

from pipeline.errors import BadInput, BadParameter, together
from pipeline.formats import IN_FILM, OUTPUTS, PASS_FORMATS, output_format
from pipeline.formats.base import OutputFormat, Profile
from pipeline.methods.base import Method, Params
from pipeline.video.writer import check_colour
from workers.contract.record import Asset
from workers.contract.request import MAX_QUALITY, Alpha, OutputSpec


def check_output(chosen: Method, output: OutputSpec) -> None:
    """Check that the method and the format can make such an output. Raises BadParameter."""
    if found := output_faults(chosen, chosen.Params(), output):
        raise together(found)


def output_faults(chosen: Method, params: Params, output: OutputSpec, video: Asset | None = None) -> list[BadInput]:
    """Faults of an output that the method with these parameters, and the format, cannot make of the video."""
    known = ", ".join(chosen.artefacts) or "none"
    found: list[BadInput] = [
        _fault("output.artefacts", artefact, f"The method {chosen.name!r} makes: {known}.")
        for artefact in output.artefacts if artefact not in chosen.artefacts
    ]  # fmt: skip
    found += pass_faults(chosen, params, output)
    if not 0 <= output.quality <= MAX_QUALITY:
        found.append(_fault("output.quality", output.quality, f"Use 0 (lossless) to {MAX_QUALITY}."))
    try:
        form = output_format(output.format)
        profile = form.profile(output.profile)
        if video is not None and video.info.get("width"):
            form.check(profile, (int(video.info["width"]), int(video.info["height"])), float(video.info["fps"]))
        check_colour(form.name, profile, output.colour)
        _check_alpha(chosen, params, form, profile, output.alpha)
        _check_holds_passes(form, profile, output.passes_format)
    except BadParameter as fault:
        found.append(fault)
    return found


def pass_faults(chosen: Method, params: Params, output: OutputSpec) -> list[BadInput]:
    """Faults of the passes that a job asks for."""
    known = [one.name for one in chosen.passes_of(params)]
    found: list[BadInput] = [
        BadParameter(
            f"The method {chosen.name!r} makes no pass {name!r}.", field="output.passes", value=name,
            remedy=f"It makes: {', '.join(known) or 'none'}.",
        )
        for name in output.passes if name not in known
    ]  # fmt: skip
    if output.passes_format not in ("", *PASS_FORMATS):
        found.append(_fault("output.passes_format", output.passes_format, f"Use one of: {', '.join(PASS_FORMATS)}."))
    elif output.passes_format and not output.passes:
        found.append(BadParameter(
            "A format of passes is given, and no pass.", field="output.passes", value=[],
            remedy=f"Name passes: {', '.join(known) or 'the method makes none'}.",
        ))  # fmt: skip
    return found


def _check_holds_passes(form: OutputFormat, profile: Profile, passes_format: str) -> None:
    if passes_format == IN_FILM and not profile.is_float:
        others = ", ".join(name for name, each in OUTPUTS.items() if any(one.is_float for one in each.profiles))
        raise BadParameter(
            f"Images of {form.title} hold no passes.", field="output.passes_format", value=passes_format,
            remedy=f"Use the format {others}, or other files for the passes: {', '.join(PASS_FORMATS[:-1])}.",
        )  # fmt: skip


def _check_alpha(chosen: Method, params: Params, form: OutputFormat, profile: Profile, alpha: Alpha) -> None:
    if alpha not in get_args(Alpha):
        raise _fault("output.alpha", alpha, f"Use one of: {', '.join(get_args(Alpha))}.")
    makes = chosen.paints_opacity(params)
    if alpha == "painted" and makes == "no":
        message = f"The method {chosen.name!r} with these parameters paints no opacity of its own."
        raise BadParameter(message, field="output.alpha", value=alpha, remedy="Use source or none.")
    if alpha != "painted" and makes == "must":
        raise BadParameter("A layer alone has opacity.", field="output.alpha", value=alpha, remedy="Use painted.")
    if alpha in ("source", "painted") and not profile.has_alpha:
        others = [
            f"{each.name} {other.name}" for each in OUTPUTS.values() for other in each.profiles if other.has_alpha
        ]
        raise BadParameter(
            f"{form.title}, {profile.title} has no opacity.", field="output.alpha", value=alpha,
            remedy=f"Use none, or one of: {', '.join(others)}.",
        )  # fmt: skip


def _fault(field: str, value: object, remedy: str) -> BadParameter:
    return BadParameter("Not accepted.", field=field, value=value, remedy=remedy)

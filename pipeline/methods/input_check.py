"""One check of all inputs of a job before any work, from facts that are known without decoding a picture."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from pipeline.errors import BadParameter
from pipeline.methods.base import AnyParams, InputSpec, Method
from pipeline.methods.input_facts import InputFacts

_ASPECT = 0.02
"""Relative difference of aspect ratios that is no fault: small pictures are rounded to whole pixels."""


def input_faults(chosen: Method, params: AnyParams, facts: Mapping[str, InputFacts]) -> list[BadParameter]:
    """Every fault of the inputs together.

    Args:
        facts: of the given inputs, by name.
    """
    specs = {spec.name: spec for spec in chosen.inputs_of(params)}
    found: list[BadParameter] = []
    for name, own in facts.items():
        if name in specs:
            found += [*_size_faults(specs[name], own, facts), *_document_faults(chosen, name, own, facts)]
    return [*found, *chosen.input_faults(params, facts)]


def _size_faults(spec: InputSpec, own: InputFacts, facts: Mapping[str, InputFacts]) -> Iterator[BadParameter]:
    field, fits = f"inputs.{spec.name}", spec.fits
    size, aspect = facts.get(fits.size), facts.get(fits.aspect)
    value = f"{own.width}x{own.height}"
    if size and own.width and size.width and (own.width, own.height) != (size.width, size.height):
        wanted = f"{size.width}x{size.height}"
        message = f"The input {spec.name!r} is {value}, and {fits.size!r} is {wanted}."
        yield BadParameter(message, field=field, value=value, remedy=f"Make it {wanted}.")
    if aspect and own.width and aspect.width and not _alike(own, aspect):
        wanted = f"{aspect.width}x{aspect.height}"
        message = f"The input {spec.name!r} has another aspect ratio than {fits.aspect!r}."
        yield BadParameter(message, field=field, value=value, remedy=f"Make it {wanted}, or the same aspect ratio.")
    other = facts.get(fits.frames)
    if other and own.frames and other.frames and _short(own.frames, other.frames, fits.exactly):
        message = f"The input {spec.name!r} has {own.frames} frames, and {fits.frames!r} has {other.frames}."
        remedy = f"Give one for each of {other.frames} frames."
        yield BadParameter(message, field=field, value=own.frames, remedy=remedy)


def _alike(one: InputFacts, other: InputFacts) -> bool:
    return abs(one.width * other.height / (one.height * other.width) - 1) <= _ASPECT


def _short(frames: int, wanted: int, exactly: bool) -> bool:
    return frames != wanted if exactly else frames < wanted


def _document_faults(
    chosen: Method, name: str, own: InputFacts, facts: Mapping[str, InputFacts]
) -> Iterator[BadParameter]:
    check = chosen.input_checks.get(name)
    if check is None or own.document is None:
        return
    frames = facts["video"].frames if "video" in facts else 0
    for fault in check(own.document, frames=frames or None, masks="masks" in facts):
        place = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in fault.path)
        yield BadParameter(fault.message, field=f"inputs.{name}{place}", value=fault.value, remedy=fault.remedy)

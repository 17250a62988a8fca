"""Warnings of a job: facts that its user should know although the job continues."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict

from pipeline.methods.base import Ineffective
from pipeline.video.damage import Damage
from pipeline.video.media import Note
from workers.contract.record import JobWarning
from workers.contract.request import Json

DAMAGED_INPUT = "damaged-input"
"""Code: frames of an input are missing or unreadable."""
DEPTH = "depth"
"""Code: the film's profile holds more bits than the method paints."""
JOINING = "joining"
"""Code: how the films of shots that differ are joined."""
METHOD = "method"
"""Code: the method tells something about the inputs and the result."""
NO_ARTEFACT = "no-artefact"
"""Code: the job made nothing of a requested artefact; its film is complete."""
NO_EFFECT = "no-effect"
"""Code: a parameter, an input or an option was given that has no effect."""
PASSES = "passes"
"""Code: which render passes of the video the method uses."""
PLANNED_AGAIN = "planned-again"
"""Code: another version of Impasto began the job, and what it has left cannot be continued."""
DAMAGE_REMEDY = "Use an undamaged copy of the file, or set on_damage to 'warn' to use what can be read."


def damage_warning(name: str, damage: Damage) -> JobWarning:
    """The warning about damage of the input `name`."""
    return JobWarning(DAMAGED_INPUT, describe_damage(name, damage), name, damage.as_json())


def depth_warning(method: str, profile: str) -> JobWarning:
    """The warning about a profile that holds finer steps than the method makes."""
    message = f"The method {method!r} paints 8 bit a channel: {profile} holds these values, without finer steps."
    return JobWarning(DEPTH, message, "", {})


def joining_warning(message: str) -> JobWarning:
    """What is decided for the shots of a film that differ in size or frame rate."""
    return JobWarning(JOINING, message, "", {})


def method_warning(message: str) -> JobWarning:
    """What a method tells its user."""
    return JobWarning(METHOD, message, "", {})


def no_artefact_warning(name: str) -> JobWarning:
    """The warning about a requested artefact that was not made."""
    message = f"The artefact {name!r} could not be made of this video with these settings."
    return JobWarning(NO_ARTEFACT, message, "", {})


def no_effect_warning(found: Ineffective) -> JobWarning:
    """The warning about a parameter or an input without effect."""
    kind, _, name = found.field.partition(".")
    return JobWarning(NO_EFFECT, found.message, name if kind == "inputs" else "", {})


def unused_warning(field: str, why: str) -> JobWarning:
    """The warning about a field of the output or the source that has no effect."""
    return JobWarning(NO_EFFECT, f"{field} has no effect: {why}.", "", {})


def note_warning(name: str, note: Note) -> JobWarning:
    """The warning with what was chosen, corrected, assumed or left out of the input `name`."""
    what = "" if name == "video" else f"The input {name!r}: "
    return JobWarning(note.code, what + note.message, name, {})


def describe_damage(name: str, damage: Damage) -> str:
    """One sentence about damage of the input `name`."""
    return damage.describe("The source" if name == "video" else f"The input {name!r}")


def merged_warnings(known: Iterable[Json], new: Iterable[JobWarning]) -> list[Json]:
    """Warnings as JSON, of damage one for each input: tasks read different frames of the same file."""
    found = {_key(each["code"], each["input"], each["message"]): each for each in known}
    for warning in new:
        key = _key(warning.code, warning.input, warning.message)
        before = found.get(key)
        if before is not None and warning.code == DAMAGED_INPUT:
            whole = Damage.from_json(before["damage"]).union(Damage.from_json(warning.damage))
            warning = damage_warning(warning.input, whole)
        found[key] = asdict(warning)
    return list(found.values())


def _key(code: str, name: str, message: str) -> tuple[str, str, str]:
    return code, name, "" if code == DAMAGED_INPUT else message

"""Warnings of a job: facts that its user should know although the job continues."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict

from pipeline.video.damage import Damage
from workers.model import JobWarning, Json

DAMAGED_INPUT = "damaged-input"
"""Code: frames of an input are missing or unreadable."""
READING = "reading"
"""Code: what was assumed, corrected or left out when an input was read."""
DAMAGE_REMEDY = "Use an undamaged copy of the file, or set on_damage to 'warn' to use what can be read."


def damage_warning(name: str, damage: Damage) -> JobWarning:
    """The warning about damage of the input `name`."""
    return JobWarning(DAMAGED_INPUT, describe_damage(name, damage), name, damage.as_json())


def reading_warning(name: str, notes: Iterable[str]) -> JobWarning:
    """The warning about how the input `name` is read."""
    what = "" if name == "video" else f"The input {name!r}: "
    return JobWarning(READING, what + " ".join(notes), name, {})


def describe_damage(name: str, damage: Damage) -> str:
    """One sentence about damage of the input `name`."""
    return damage.describe("The source" if name == "video" else f"The input {name!r}")


def merged_warnings(known: Iterable[Json], new: Iterable[JobWarning]) -> list[Json]:
    """Warnings as JSON, one for each input: tasks read different frames of the same file."""
    found = {(each["code"], each["input"]): each for each in known}
    for warning in new:
        before = found.get((warning.code, warning.input))
        if before is not None and warning.damage:
            whole = Damage.from_json(before["damage"]).union(Damage.from_json(warning.damage))
            warning = damage_warning(warning.input, whole)
        found[warning.code, warning.input] = asdict(warning)
    return list(found.values())

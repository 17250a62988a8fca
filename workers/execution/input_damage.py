"""Damage of the inputs that an attempt reads: collected for a warning, or raised as an error if the job requests
that."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from pipeline.errors import DamagedMedia
from pipeline.video.damage import damage_of
from pipeline.video.index import Index
from pipeline.video.media import Note
from workers.contract.record import JobWarning
from workers.jobs.job_warnings import DAMAGE_REMEDY, damage_warning, describe_damage, note_warning


def within(index: Index, span: tuple[int, int | None]) -> Index:
    """The index without the missing frames that frames [start, end) do not need; end None: to the end of the video."""
    start, end = span
    needed = [gap for gap in index.missing if start < gap[0] and (end is None or gap[0] < end)]
    return replace(index, missing=tuple(needed))


class InputDamage:
    """
    Args:
        fails: whether damage is an error.
    """

    def __init__(self, fails: bool) -> None:
        self._fails = fails
        self._unreadable: dict[str, tuple[Index, set[int]]] = {}
        self._notes: dict[str, tuple[Note, ...]] = {}

    def note(self, name: str, notes: Iterable[Note]) -> None:
        """Record what was assumed, corrected or left out when the input `name` was opened."""
        if found := tuple(notes):
            self._notes[name] = found

    def record(self, name: str, index: Index, unreadable: Iterable[int]) -> None:
        """Record the damage that a reader of the input `name` has found so far. Raises DamagedMedia."""
        found = self._unreadable.setdefault(name, (index, set()))[1]
        found.update(unreadable)
        if self._fails and (found or index.missing):
            raise DamagedMedia(
                describe_damage(name, damage_of(index, found)),
                field=f"inputs.{name}",
                remedy=DAMAGE_REMEDY,
            )

    def warnings(self) -> tuple[JobWarning, ...]:
        """One warning for each damaged input, and one for each note."""
        found = {name: damage_of(index, unreadable) for name, (index, unreadable) in self._unreadable.items()}
        damaged = (damage_warning(name, damage) for name, damage in found.items() if damage)
        return (*damaged, *(note_warning(name, note) for name, notes in self._notes.items() for note in notes))

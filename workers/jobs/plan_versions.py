"""Versions of a job's steps: whether this program can continue what another one has planned.

A job carries the version of each of its steps (`pipeline.methods.base.Step.version`): of the tasks' args, and of the
results and artefacts that they leave. A program runs and plans only what it can read. What an older program has left is
planned again from the first step that cannot be read. What a newer one has left waits for such a program.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

Versions = Sequence[tuple[str, int]]
"""(Name, version) of each step of a job, in order. Those of a program before versions are unknown: empty."""


class StepVersion(NamedTuple):
    """A step of this program."""

    name: str
    version: int
    reads: tuple[int, ...] = ()
    """Lower versions that it can continue from."""


def is_newer(stored: Versions, own: Sequence[StepVersion]) -> bool:
    """Whether a newer program has planned the job. A change of the list of steps raises the version of the first."""
    known = {step.name: step.version for step in own}
    return any(version > known[name] for name, version in stored if name in known)


def first_unreadable(stored: Versions, own: Sequence[StepVersion]) -> int | None:
    """Index of the first of the program's own steps that cannot be continued from; None: all can be."""
    for index, step in enumerate(own):
        name, version = stored[index] if index < len(stored) else ("", 0)
        if name != step.name or not (version == step.version or version in step.reads):
            return index
    return len(own) - 1 if len(stored) > len(own) else None

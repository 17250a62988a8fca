"""What a session's parts remember: arrays by dotted name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import Any

from numpy.typing import NDArray

Clock = Callable[[str], AbstractContextManager[None]]
"""Called with a stage's name; times what is done inside."""
State = dict[str, NDArray[Any]]


def no_clock(stage: str) -> AbstractContextManager[None]:
    """Times nothing."""
    return nullcontext()


def flatten(parts: Mapping[str, Mapping[str, NDArray[Any]]]) -> State:
    """{"a": {"b": x}} -> {"a.b": x}."""
    return {f"{name}.{key}": array for name, part in parts.items() for key, array in part.items()}


def part(state: Mapping[str, NDArray[Any]], name: str) -> State:
    """What `flatten` had under `name`."""
    return {key[len(name) + 1 :]: array for key, array in state.items() if key.startswith(name + ".")}

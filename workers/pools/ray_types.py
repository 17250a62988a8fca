"""Aliases for values of Ray, which ships no types that a strict checker accepts."""

from __future__ import annotations

from typing import Any, TypeAlias

import ray

ObjectRef: TypeAlias = Any
"""Reference to a value in Ray's object store, or to the answer of a call."""
Actor: TypeAlias = Any
"""Handle of an actor, or its class before `options` and `remote`."""
RAY: Any = ray
"""The module `ray`, unchecked."""

CONTROL = "control"
"""Concurrency group of calls that are answered while another call runs."""

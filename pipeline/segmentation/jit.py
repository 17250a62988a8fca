"""The one way serial label work is compiled: Numba, cached on disk, without the interpreter lock, strict floats."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., object])


def kernel(function: F) -> F:
    """Compile `function` ahead of its first use in a process; equal inputs give equal bytes on every machine."""
    return cast(F, numba.njit(cache=True, nogil=True, fastmath=False, error_model="numpy")(function))

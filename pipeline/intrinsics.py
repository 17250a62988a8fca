"""Base class of functions that generate LLVM instructions in kernels, for what Numba has no expression for."""

from __future__ import annotations

from functools import cached_property
from typing import Any


class Intrinsic:
    """A function that kernels call. A subclass has two versions of it: `__call__`, for calls outside of kernels, and
    the instructions, from `generator`.

    Numba is imported at the first use in a kernel, as in `pipeline.jit`.
    """

    def generator(self) -> Any:
        """A function as Numba's decorator `intrinsic` takes it."""
        raise NotImplementedError

    @cached_property
    def _numba_type_(self) -> Any:
        """The type that this has for Numba in a kernel that calls it."""
        from numba.core.registry import cpu_target
        from numba.extending import intrinsic

        instructions, known = intrinsic(self.generator()), cpu_target.typing_context
        known.refresh()  # it learns of new intrinsics here
        return known.resolve_value_type(instructions)

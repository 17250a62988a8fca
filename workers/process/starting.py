"""The start of a process that imports hundreds of modules and loads kernels."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

WARM_UP_THREAD = "impasto-warm-up"
"""Name of the thread that loads kernels beside the start."""


@contextmanager
def without_garbage_collection() -> Iterator[None]:
    """For imports and other work whose objects live as long as the process.

    Searches for garbage among them take a sixth of the CPU time of a start. Afterwards the collector leaves out what is
    there: it is scarcely ever garbage, and collections are short without it.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()

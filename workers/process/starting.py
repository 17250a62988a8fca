"""The start of a process that imports hundreds of modules and loads kernels."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

WARM_UP_THREAD = "impasto-warm-up"
"""Name of the thread that loads kernels while the process starts."""


@contextmanager
def without_garbage_collection() -> Iterator[None]:
    """Disables garbage collection during imports and other work whose objects live as long as the process.

    Collections among these objects take a sixth of the CPU time of a start. Afterwards the collector ignores the
    existing objects, because they scarcely ever become garbage, and later collections are short.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


HUNG_STATUS = 75
"""Exit status of a process that has ended itself because an attempt hung in one of its threads (EX_TEMPFAIL)."""

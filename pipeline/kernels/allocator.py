"""Settings of the C library's allocator (glibc's `mallopt`). They do nothing with another C library."""

from __future__ import annotations

import ctypes

_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -3, -8
"""Numbers of parameters in glibc's malloc.h."""
_LARGEST_KEPT_BYTES = 32 << 20
"""Largest block that is kept, bytes; glibc allows no more."""


def limit_arenas(count: int) -> None:
    """Limit the number of arenas, each of which keeps free memory. Call it before threads start."""
    _set(_ARENA_MAX, count)


def keep_freed_memory(most_bytes: int) -> None:
    """Keep freed memory in the process, up to `most_bytes` at the end of each arena. Call it before threads start.

    By default, large arrays return to the operating system when they are freed. New ones then cost a page fault for
    every 4 KiB, during which the process's other threads may have to wait.
    """
    _set(_MMAP_THRESHOLD, _LARGEST_KEPT_BYTES)
    _set(_TRIM_THRESHOLD, most_bytes)


def _set(parameter: int, value: int) -> None:
    if (mallopt := getattr(ctypes.CDLL(None), "mallopt", None)) is not None:
        mallopt(parameter, value)

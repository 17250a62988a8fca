"""Counter-based random numbers: Philox 4x32-10.

A number is a function of a key (seed and purpose) and a counter (stroke id) alone. There is no generator state, so a
stroke draws the same numbers in any task, in any order and on any machine.
"""

from __future__ import annotations

from enum import IntEnum
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.jit import kernel

Ids = NDArray[np.uint64]
"""Stroke identifiers, `uint64` (n,); equal ids draw equal numbers."""

Word: TypeAlias = int | np.uint64
"""A 32-bit word: any integer as input, `uint64` as output."""

_LOW = np.uint64(0xFFFFFFFF)
_SHIFT = np.uint64(32)
_M0, _M1 = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_W0, _W1 = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_UNIT = 2.0**-24

KEPT_TEXTURES = 8
"""Maximum number of seeds whose textures stay in memory, for concurrent jobs. In a service, each job has a new seed."""


class Purpose(IntEnum):
    """Use of a random number; numbers for different purposes are independent."""

    PLACE = 1
    COLOUR = 2
    ORDER = 3
    BRISTLES = 4
    WEAVE = 5


@kernel
def philox(c0: Word, c1: Word, c2: Word, c3: Word, k0: Word, k1: Word) -> tuple[Word, Word, Word, Word]:
    """Return four random 32-bit words for a counter of four words and a key of two words. Callable from other kernels.

    Source: salmon2011parallel, Philox 4x32 with ten rounds.
    """
    a, b, c, d = np.uint64(c0), np.uint64(c1), np.uint64(c2), np.uint64(c3)
    x, y = np.uint64(k0), np.uint64(k1)
    for _ in range(10):
        p, q = _M0 * a, _M1 * c
        a, b, c, d = (q >> _SHIFT) ^ b ^ x, q & _LOW, (p >> _SHIFT) ^ d ^ y, p & _LOW
        x, y = (x + _W0) & _LOW, (y + _W1) & _LOW
    return a, b, c, d


def draws(ids: Ids, seed: int, purpose: Purpose) -> NDArray[np.float32]:
    """Draw four numbers in [0, 1) for each id: float32 (n, 4). `seed` is taken modulo 2^32."""
    out = np.empty((len(ids), 4), np.float32)
    _draws(ids, seed & 0xFFFFFFFF, int(purpose), out)
    return out


@kernel
def _draws(ids: Ids, seed: int, purpose: int, out: NDArray[np.float32]) -> None:
    for i in range(len(ids)):
        words = philox(ids[i] & _LOW, ids[i] >> _SHIFT, 0, 0, seed, purpose)
        for k in range(4):
            out[i, k] = np.float32((np.uint64(words[k]) >> np.uint64(8)) * _UNIT)

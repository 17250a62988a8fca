"""Positions of the non-zero values of a row, for loops that visit only these."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pipeline.kernels.jit import kernel


@kernel
def nonzero_positions(flags: NDArray[np.uint8], places: NDArray[np.int32], offset: int = 0, count: int = 0) -> int:
    """Append `offset` + the indices of the non-zero `flags` to `places[count:]`; returns the new count.

    Args:
        flags: uint8 (n,), contiguous. Eight zeros in a row are skipped at once, so that few set flags cost little.
        places: int32, at least `count` + n entries.
    """
    words = flags[: flags.size // 8 * 8].view(np.uint64)
    for word in range(words.size):
        if words[word]:
            for x in range(8 * word, 8 * word + 8):
                places[count] = offset + x
                count += flags[x] != 0
    for x in range(8 * words.size, flags.size):
        places[count] = offset + x
        count += flags[x] != 0
    return count

"""Arrays that are used again for every frame: to touch fresh memory takes as long as a pass over it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


class Buffers:
    """float32 arrays by name. Not thread-safe: one object for each thread."""

    def __init__(self) -> None:
        self._arrays: dict[str, NDArray[np.float32]] = {}

    def get(self, name: str, shape: tuple[int, ...]) -> NDArray[np.float32]:
        """The array of this name and shape, with its previous contents; zeros at first."""
        found = self._arrays.get(name)
        if found is None or found.shape != shape:
            found = self._arrays[name] = np.zeros(shape, np.float32)
        return found

"""The part of torch that the node pack uses: tensors from NumPy arrays and back."""

from __future__ import annotations

import numpy as np


class Tensor(np.ndarray):
    def cpu(self) -> Tensor:
        return self

    def numpy(self) -> np.ndarray:
        return self.view(np.ndarray)


def from_numpy(array: np.ndarray) -> Tensor:
    return array.view(Tensor)

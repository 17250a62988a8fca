"""Collects the frames that a plan has emitted."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.methods.local import LocalContext


def painted(context: LocalContext[Any]) -> NDArray[np.uint8]:
    """All emitted frames in order, (n, h, w, 3); fails if one is missing."""
    assert sorted(context.emitted) == list(range(len(context.emitted)))
    return np.stack([context.emitted[index] for index in sorted(context.emitted)])

"""Random numbers that depend on a seed and a purpose only, not on the order of tasks or on the machine."""

from __future__ import annotations

import numpy as np


def seeded(seed: int, *purpose: int) -> np.random.Generator:
    """Generator for one purpose: Philox keyed by (seed, purpose...), equal on any worker in any order of tasks."""
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(seed, spawn_key=purpose)))

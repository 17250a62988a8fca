"""Seeded removal of temporal coherence, as of drawings that are made anew for each frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.methods.analogy.params import AnalogyParams
from pipeline.synthesis.images import Bytes

_BOIL_BLOCK_PX = 32
"""Side of the blocks that boil, px at full size."""
_MAX_BOIL_BLOCKS = 256
"""Number of blocks along a side; suffices for frames of up to 8192 px."""


@dataclass(frozen=True)
class Boil:
    """Deliberate flicker: in each frame, some blocks of the picture lose their temporal coherence.

    Attributes:
        params: with the fraction of the blocks, 0..1, `boil`, of each frame.
        seed: random seed.
        level: 0 = full size.
    """

    params: AnalogyParams
    seed: int
    level: int

    def coherent(self, first: int, size: tuple[int, ...]) -> Bytes:
        """1 where frames `first` and `first` + 1 stay coherent, uint8 (h, w). The same blocks at every level."""
        block = max(1, _BOIL_BLOCK_PX >> self.level)
        height, width = size[:2]
        shape = (-(-height // block), -(-width // block))
        draws = np.random.Generator(np.random.Philox(key=[self.seed, first])).random(
            (_MAX_BOIL_BLOCKS, _MAX_BOIL_BLOCKS)
        )
        coherent = (draws >= self.params.at(first).boil).astype(np.uint8)[: shape[0], : shape[1]]
        return np.ascontiguousarray(coherent.repeat(block, 0).repeat(block, 1)[:height, :width])

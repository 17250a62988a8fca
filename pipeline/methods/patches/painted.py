"""A patch that is painted, as the frames of a run need it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.frames import Frame, Plane
from pipeline.methods.base import Bench, Note
from pipeline.methods.patches.fit import Look
from pipeline.methods.patches.join import load_lays
from pipeline.methods.patches.lives import Life
from pipeline.warp.panorama import Lay

TURN = 3.0
"""Frames before and after the change of two ages in which one fades over into the other."""


@dataclass(frozen=True)
class Painted:
    """A patch that is painted.

    Attributes:
        life: when it is there.
        ages: [start, stop) of each of its pictures; panorama and painting of those that are needed, by number.
        origin: (x, y) of the first pixel of all of them, px.
        lays: where it lies, by frame.
    """

    life: Life
    ages: list[list[int]]
    looks: dict[int, tuple[Frame, Frame]]
    origin: tuple[int, int]
    lays: dict[int, Lay]

    @classmethod
    def load(cls, life: Life, note: Note, start: int, stop: int, bench: Bench) -> Painted:
        """What frames [start, stop] need of a patch: those of one run and the next one. `note` is its task's."""
        lays, looks = load_lays(bench, life, start, stop), {}
        for number, (first, last) in enumerate(note["ages"]):
            if first - TURN <= stop and last + TURN > start:
                kept = bench.load("patch", f"{life.key}-age{number}")
                looks[number] = kept["panorama"], kept["painting"]
        x, y = note["origin"]
        return cls(life, note["ages"], looks, (x, y), lays)

    def at(self, index: int, x: Plane, y: Plane) -> Look:
        """The patch as it is in a frame, and its paint, at places of the panorama.

        Between two ages one fades over into the other.
        """
        look = np.zeros((2, *x.shape, 3), np.float32)
        for number, share in self._shares(index):
            for which, (plane, how) in enumerate(
                zip(self.looks[number], (cv2.INTER_LINEAR, cv2.INTER_CUBIC), strict=True)
            ):
                look[which] += np.float32(share) * cv2.remap(plane, x, y, how, borderMode=cv2.BORDER_REPLICATE)
        return look

    def _shares(self, index: int) -> list[tuple[int, float]]:
        number = next(n for n, (first, last) in enumerate(self.ages) if first <= index < last)
        first, last = self.ages[number]
        since, until = index - first + 0.5, last - index - 0.5
        if number > 0 and since < TURN and since <= until:
            share = 0.5 + since / (2 * TURN)
            return [(number, share), (number - 1, 1 - share)]
        if number + 1 < len(self.ages) and until < TURN:
            share = 0.5 + until / (2 * TURN)
            return [(number, share), (number + 1, 1 - share)]
        return [(number, 1.0)]

"""Placement of a patch in its frames: warps are concatenated from the master frame outward and relaxed jointly."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from pipeline.frames import Mask
from pipeline.methods.base import TaskContext
from pipeline.methods.patches.clusters import LabelMaps
from pipeline.methods.patches.lives import Life
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.register import Hop, load_hops, save_hops
from pipeline.methods.patches.scan import run_key, run_of
from pipeline.warp.homography import IDENTITY, Homography
from pipeline.warp.panorama import Lay
from pipeline.warp.springs import Relaxed, Sheet, relax

STRIDE = 2
"""Subsampling of pixels in the joint relaxation."""
MOST_SHEETS = 24
"""Largest number of frames in the joint relaxation. Neighbouring frames are redundant, so an even sample suffices."""
CELL = 4.0
"""Cell size of the grid of the joint relaxation, working px."""


def joined(life: Life, hops: Callable[[int], Hop | None], size: tuple[int, int]) -> dict[int, Lay]:
    """Placement of the patch in each frame that contains it, from warps concatenated outward from the master frame.

    Args:
        hops: returns the warp of a frame, see `Hops`; the master frame must have one.
        size: (width, height) of a frame, working px.
    """
    first = hops(life.master)
    assert first is not None, "the master frame has the patch"
    lays = {life.master: Lay(first.rect, IDENTITY, first.shift)}
    for order in (range(life.master + 1, life.stop), range(life.master - 1, life.start - 1, -1)):
        for index in order:
            hop = hops(index)
            if hop is not None and index + hop.gap in lays:
                lays[index] = _concatenated(hop, lays[index + hop.gap], (0, 0, *size))
    return dict(sorted(lays.items()))


@dataclass
class Hops:
    """Loads the warps of one patch, holding one run in memory."""

    life: Life
    context: TaskContext[PatchesParams]
    held: dict[int, dict[int, Hop]] = field(default_factory=dict)

    def __call__(self, index: int) -> Hop | None:
        start = run_of(index, self.life.begin)
        if start not in self.held:
            self.held = {start: load_hops(self.context, f"{self.life.key}-{run_key(start)}")}
        return self.held[start].get(index)


def _concatenated(hop: Hop, before: Lay, whole: tuple[int, int, int, int]) -> Lay:
    """Placement of a frame: the warp `hop`, followed by the placement of its target frame."""
    here = Lay(hop.rect, IDENTITY, hop.shift).positions()
    places = before.at(here)
    matrix = before.matrix @ hop.matrix
    matrix = matrix / matrix[2, 2]
    if not _sane(matrix, whole):
        matrix = before.matrix
    flat = Lay(hop.rect, matrix, np.zeros_like(hop.shift)).positions()
    return Lay(hop.rect, matrix, (places - flat).astype(np.float16))


def _sane(matrix: Homography, whole: tuple[int, int, int, int]) -> bool:
    """Whether the homography is free of folds and extreme scales over the frame."""
    corners = np.array([[x, y, 1.0] for x in (whole[0], whole[2]) for y in (whole[1], whole[3])])
    depth = corners @ matrix[2]
    size = abs(np.linalg.det(matrix[:2, :2]))
    return bool(np.isfinite(matrix).all() and depth.min() > 0.3 and depth.max() < 3 and 0.05 < size < 20)


def settle(lays: dict[int, Lay], life: Life, maps: LabelMaps, params: PatchesParams) -> Relaxed:
    """Relax the patch over all frames on one grid, and update the placements in place."""
    sheets = []
    for index in evenly(list(lays), MOST_SHEETS):
        lay = lays[index]
        labels = maps.sure(index)
        sheets.append(sheet_of(lay, labels == life.label, params, STRIDE))
    relaxed = relax(sheets, CELL)
    for index, lay in lays.items():
        places = lay.positions()
        rest = lay.rest + (relaxed.moved(places) - places)
        lays[index] = Lay(lay.rect, lay.matrix, rest.astype(np.float16))
    return relaxed


def sheet_of(lay: Lay, inside: Mask, params: PatchesParams, stride: int) -> Sheet:
    """Spring system of every `stride`-th pixel of the patch in a frame, with its placement as the target.

    Args:
        inside: bool (h, w), the patch's cluster in the whole frame, at the working size.
    """
    left, top, right, bottom = lay.rect
    mask = np.ascontiguousarray(inside[top:bottom:stride, left:right:stride])
    scale = float(np.sqrt(abs(np.linalg.det(lay.matrix[:2, :2]))))
    targets = np.ascontiguousarray(lay.positions()[::stride, ::stride])
    return Sheet(targets, mask, np.full(mask.shape, params.stiffness, np.float32), scale * stride)


def evenly(items: list[int], most: int) -> list[int]:
    """Choose at most `most` items, evenly spaced, including both ends."""
    if len(items) <= most:
        return items
    return [items[place] for place in np.linspace(0, len(items) - 1, most).round().astype(int).tolist()]


def save_lays(context: TaskContext[PatchesParams], life: Life, lays: Mapping[int, Lay]) -> None:
    """Save the placements by run as artefacts "<life>-<run>", each with the run's frames and the frame after them."""
    by_run: dict[int, dict[int, Hop]] = {run_of(index, life.begin): {} for index in range(life.start, life.stop)}
    for index, lay in lays.items():
        for run in {run_of(index, life.begin), run_of(max(index - 1, life.begin), life.begin)} & set(by_run):
            by_run[run][index] = Hop(lay.rect, 0, lay.matrix, lay.rest)
    for start, hops in by_run.items():
        save_hops(context, f"{life.key}-{run_key(start)}", hops)


def load_lays(context: TaskContext[PatchesParams], life: Life, start: int, stop: int) -> dict[int, Lay]:
    """Load the placements of frames start..stop, both included, that contain the patch.

    Frame `stop` is included only if a run that begins before it contains the patch.
    """
    lays = {}
    for run in sorted({run_of(index, life.begin) for index in range(max(start, life.start), min(stop, life.stop))}):
        for index, hop in load_hops(context, f"{life.key}-{run_key(run)}", "patch").items():
            if start <= index <= stop:
                lays[index] = Lay(hop.rect, hop.matrix, hop.shift)
    return lays

"""Where a patch lies in all of its frames: warps joined outward from its master frame, and relaxed together."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from pipeline.frames import Mask
from pipeline.methods.base import Bench
from pipeline.methods.patches.clusters import LabelMaps
from pipeline.methods.patches.lives import Life
from pipeline.methods.patches.params import PatchesParams
from pipeline.methods.patches.register import Hop, load_hops, save_hops
from pipeline.methods.patches.scan import run_key, run_of
from pipeline.warp.homography import IDENTITY, Homography
from pipeline.warp.panorama import Lay
from pipeline.warp.springs import Relaxed, Sheet, relax

STRIDE = 2
"""Every second pixel is enough for the relaxation over all frames."""
MOST_SHEETS = 24
"""Frames of a life that are relaxed together: neighbours say nearly the same, so an even choice stands for all."""
CELL = 4.0
"""Distance of its grid's corners, working px."""


def joined(life: Life, hops: Callable[[int], Hop | None], size: tuple[int, int]) -> dict[int, Lay]:
    """Where the patch lies in every frame that has it: warps concatenated, outward from the master both ways.

    Args:
        hops: of the life's frames, see `Hops`; the master frame has one.
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
    """The warps of one patch, read run by run."""

    life: Life
    bench: Bench
    held: dict[int, dict[int, Hop]] = field(default_factory=dict)

    def __call__(self, index: int) -> Hop | None:
        start = run_of(index, self.life.begin)
        if start not in self.held:
            self.held = {start: load_hops(self.bench, f"{self.life.key}-{run_key(start)}")}
        return self.held[start].get(index)


def _concatenated(hop: Hop, before: Lay, whole: tuple[int, int, int, int]) -> Lay:
    """The frame's lay from that of the frame it hops to, in floating point throughout."""
    here = Lay(hop.rect, IDENTITY, hop.shift).positions()
    places = before.at(here)
    matrix = before.matrix @ hop.matrix
    matrix = matrix / matrix[2, 2]
    if not _sane(matrix, whole):
        matrix = before.matrix
    flat = Lay(hop.rect, matrix, np.zeros_like(hop.shift)).positions()
    return Lay(hop.rect, matrix, (places - flat).astype(np.float16))


def _sane(matrix: Homography, whole: tuple[int, int, int, int]) -> bool:
    """Whether the homography neither folds nor blows up the frame."""
    corners = np.array([[x, y, 1.0] for x in (whole[0], whole[2]) for y in (whole[1], whole[3])])
    depth = corners @ matrix[2]
    size = abs(np.linalg.det(matrix[:2, :2]))
    return bool(np.isfinite(matrix).all() and depth.min() > 0.3 and depth.max() < 3 and 0.05 < size < 20)


def settle(lays: dict[int, Lay], life: Life, maps: LabelMaps, params: PatchesParams) -> Relaxed:
    """Relax all frames on one grid, and change the lays, in place."""
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
    """Every `stride`-th pixel of a frame of the patch, on springs to where it lies; `inside` is of the whole frame."""
    left, top, right, bottom = lay.rect
    mask = np.ascontiguousarray(inside[top:bottom:stride, left:right:stride])
    scale = float(np.sqrt(abs(np.linalg.det(lay.matrix[:2, :2]))))
    targets = np.ascontiguousarray(lay.positions()[::stride, ::stride])
    return Sheet(targets, mask, np.full(mask.shape, params.stiffness, np.float32), scale * stride)


def evenly(items: list[int], most: int) -> list[int]:
    """At most so many of the items, evenly chosen, the ends among them."""
    if len(items) <= most:
        return items
    return [items[place] for place in np.linspace(0, len(items) - 1, most).round().astype(int).tolist()]


def save_lays(bench: Bench, life: Life, lays: Mapping[int, Lay]) -> None:
    """Keep the lays by run, as "<life>-<run>": those of its frames and of the one after them."""
    by_run: dict[int, dict[int, Hop]] = {run_of(index, life.begin): {} for index in range(life.start, life.stop)}
    for index, lay in lays.items():
        for run in {run_of(index, life.begin), run_of(max(index - 1, life.begin), life.begin)} & set(by_run):
            by_run[run][index] = Hop(lay.rect, 0, lay.matrix, lay.rest)
    for start, hops in by_run.items():
        save_hops(bench, f"{life.key}-{run_key(start)}", hops)


def load_lays(bench: Bench, life: Life, start: int, stop: int) -> dict[int, Lay]:
    """The lays of frames [start, stop] that have the patch; of frame `stop` if its run's predecessor has it too."""
    lays = {}
    for run in sorted({run_of(index, life.begin) for index in range(max(start, life.start), min(stop, life.stop))}):
        for index, hop in load_hops(bench, f"{life.key}-{run_key(run)}", "patch").items():
            if start <= index <= stop:
                lays[index] = Lay(hop.rect, hop.matrix, hop.shift)
    return lays
